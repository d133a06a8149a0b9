#include "bench_case.h"

#include <iterator>

#include "core/error.h"

namespace tvsgs {
namespace {

Vec3<double> vec(const NpyArray& a, int i) {
    const double* v = &a.numbers[3 * std::size_t(i)];
    return {v[0], v[1], v[2]};
}

Sym3f sym(const NpyArray& a, int i) {
    const double* T = &a.numbers[6 * std::size_t(i)];
    return {float(T[0]), float(T[1]), float(T[2]), float(T[3]), float(T[4]), float(T[5])};
}

Vec3<double> scale(const VotingCase& c, int i) {
    return vec(c.at("scales"), i);
}

/// Distances of two splats in the voter's whitened space, from the stored inputs.
class WhitenedDistance {
public:
    explicit WhitenedDistance(const VotingCase& c)
        : case_(c),
          rule_{c.options.whiten, c.options.whiten_noise_mode == NoiseMode::per_splat,
                c.options.flatness_limit} {
        for (int i = 0; i < c.size(); ++i) {
            const auto s = limit_flatness(scale(c, i), double(c.options.flatness_limit));
            mean_trace_ += dot(s, s) / c.size();
        }
    }
    double operator()(int i, std::uint32_t j) const {
        const auto w = whitening(quat_cast<double>(case_.splats.quats[std::size_t(i)]),
                                 scale(case_, i), rule_, kWhitenNoise * mean_trace_);
        const Vec3<double> d = vec_cast<double>(case_.splats.means[j]) -
                               vec_cast<double>(case_.splats.means[std::size_t(i)]);
        return norm(whitened_from_world(w) * d);
    }

private:
    const VotingCase& case_;
    WhitenRule rule_;
    double mean_trace_ = 0;
};

void compare_lists(const VotingCase& c, const VotingDetails& details, CaseDifferences& out) {
    const WhitenedDistance distance(c);
    for (int i = 0; i < c.size(); ++i) {
        const auto mine = sorted_row(details.receivers, c.k, i),
                   oracles = sorted_row(c.receivers, c.k, i);
        std::vector<std::uint32_t> differ;
        std::set_symmetric_difference(mine.begin(), mine.end(), oracles.begin(), oracles.end(),
                                      std::back_inserter(differ));
        if (differ.empty()) continue;
        ++out.lists_with_ties;
        double farthest = 0;
        for (const auto j : oracles) farthest = std::max(farthest, distance(i, j));
        for (const auto j : differ) {
            const double off = distance(i, j);
            if (off != farthest) out.list = std::max(out.list, std::abs(off / farthest - 1));
        }
    }
}

/// The oracle counts votes of weight 0 from splats that no vote has reached; these do not vote.
bool heard_from_tensorless(const FieldOnHost& f, int i) {
    for (auto e = f.details.begin[std::size_t(i)]; e < f.details.begin[std::size_t(i) + 1]; ++e)
        if ((f.flags[f.details.voters[std::size_t(e)]] & kHasTensor) == 0) return true;
    return false;
}

void compare_field(const VotingCase& c, const FieldOnHost& f, CaseDifferences& out) {
    const int count = c.size();
    std::vector<double> sizes, gaps;
    for (int i = 0; i < count; ++i) {
        sizes.push_back(frobenius(sym(c.at("tensor"), i)));
        gaps.push_back(relative_gap(vec_cast<float>(vec(c.at("eigenvalues"), i))));
    }
    // A tensor far below the others is made of votes in the exponential's tail, where a rounding
    // error of the inputs (scales are stored as logarithms) grows by a factor of up to 50.
    const double least = 0.01 * middle(sizes);
    const auto widen = [](double& largest, double value) {
        if (!(value <= largest)) largest = value;  // NaN stays
    };
    for (int i = 0; i < count; ++i) {
        const std::size_t s = std::size_t(i);
        widen(out.tau, std::abs(f.details.tau[s] / c.at("tau").numbers[s] - 1));
        out.left_out += f.details.left_out[s] != c.at("left_out").numbers[s];
        // Votes below 1e-12 are zero by definition here, which the oracle does not know: it goes on
        // with their sums.
        const double strength = c.at("strength").numbers[s];
        if (strength < 1e-8) {
            ++out.weak;
            out.flags += (f.flags[s] & kPositionValid) != 0;
            continue;
        }
        const Sym3f oracle = sym(c.at("tensor"), i);
        widen(out.tensor, frobenius(difference(f.tensors[s], oracle)) / std::max(sizes[s], least));
        out.flags += ((f.flags[s] & kNormalValid) != 0) != (gaps[s] >= kMinNormalGap);
        if (!heard_from_tensorless(f, i))
            widen(out.strength, std::abs(f.details.strength[s] / strength - 1));
        if (!(gaps[s] > kComparedGap)) continue;
        widen(out.normal_deg, angle_deg(vec_cast<double>(f.normals[s]), vec(c.at("normal"), i)));

        // Less what storing a point as floats rounds away. Another receiver is as good where
        // saliencies tie.
        const Vec3<double> scales = scale(c, i), wanted = vec(c.at("target"), i);
        const double step = std::max({scales.x, scales.y, scales.z}) / 5;
        const double off = norm(vec_cast<double>(f.targets[s]) - wanted) - norm(wanted) * 1.1e-7;
        if (off / step > 0.5)
            ++out.targets_elsewhere;
        else
            widen(out.target_steps, off / step);

        // One normal that is arbitrary spoils the variability of all who list it.
        const auto* row = &c.receivers[s * std::size_t(c.k)];
        if (std::all_of(row, row + c.k, [&](std::uint32_t j) { return gaps[j] > kComparedGap; }))
            widen(out.variability_deg,
                  std::abs(f.details.variability[s] - c.at("variability").numbers[s]) * 180 / kPi);
    }
}

}  // namespace

VotingCase read_voting_case(const std::string& path) {
    VotingCase c;
    c.name = path;
    c.arrays = read_npz(path);
    const std::vector<std::int64_t>& shape = c.at("means").shape;
    const std::int64_t count = shape.empty() ? 0 : shape[0];
    const auto expect_shape = [&](const char* name, std::vector<std::int64_t> wanted) {
        if (c.at(name).shape != wanted || c.at(name).is_text)
            throw Error(ExitCode::input,
                        str(path, ": array '", name, "' has not the shape that belongs to ", count,
                            " splats; expected a case of the oracle, tensor_voting.py --make"));
    };
    if (c.at("index").shape.size() == 2) c.k = static_cast<int>(c.at("index").shape[1]);
    if (count < 2 || count > 10'000'000 || c.k < 1)
        throw Error(ExitCode::input, str(path, ": ", count, " splats with lists of ", c.k,
                                         "; expected a case of the oracle, tensor_voting.py "
                                         "--make"));
    for (const char* name : {"means", "scales", "eigenvalues", "normal", "target"})
        expect_shape(name, {count, 3});
    for (const char* name : {"tau", "variability", "strength", "left_out"})
        expect_shape(name, {count});
    for (const char* name : {"k", "rounds", "whiten", "flatness_limit"}) expect_shape(name, {});
    expect_shape("quats", {count, 4});
    expect_shape("tensor", {count, 6});
    expect_shape("index", {count, c.k});

    const auto number = [&](const char* name) { return c.at(name).numbers[0]; };
    resize(c.splats, static_cast<int>(count), 0);
    fill_zero(c.splats);
    for (int i = 0; i < c.size(); ++i) {
        const std::size_t s = std::size_t(i);
        const double* q = &c.at("quats").numbers[4 * s];
        const Vec3f scales = vec_cast<float>(scale(c, i));
        c.splats.means[s] = vec_cast<float>(vec(c.at("means"), i));
        c.splats.quats[s] = {float(q[0]), float(q[1]), float(q[2]), float(q[3])};
        c.splats.log_scales[s] = {std::log(scales.x), std::log(scales.y), std::log(scales.z)};
    }
    for (const double j : c.at("index").numbers) {
        if (!(j >= 0 && j < static_cast<double>(count)))
            throw Error(ExitCode::input,
                        str(path, ": array 'index' names splat ", j, " of ", count));
        c.receivers.push_back(static_cast<std::uint32_t>(j));
    }
    c.options.k = static_cast<int>(number("k"));
    c.rounds = static_cast<int>(number("rounds"));
    if (c.options.k < 1 || c.rounds < 1)
        throw Error(ExitCode::input, str(path, ": k ", number("k"), ", rounds ", number("rounds"),
                                         "; expected 1 or more"));
    c.options.whiten = number("whiten") != 0;
    c.options.flatness_limit = c.options.flatness_limit_position =
        static_cast<float>(number("flatness_limit"));
    if (c.at("mode").text == "per_splat") c.options.whiten_noise_mode = NoiseMode::per_splat;
    if (c.at("vote_map").text == "unit") c.options.vote_map = VoteMap::unit;
    return c;
}

CaseDifferences compare_with_case(const VotingCase& c, const RunCase& run) {
    FieldOnHost field = run({});
    CaseDifferences out;
    out.same_length = field.details.k == c.k;
    if (!out.same_length) return out;
    compare_lists(c, field.details, out);
    if (out.lists_with_ties > 0) field = run(c.receivers);
    compare_field(c, field, out);
    return out;
}

std::vector<CaseBound> case_bounds(const CaseDifferences& d) {
    // Ties are within the rounding of float distances and of scales stored as logarithms.
    return {{"list", d.same_length ? d.list : 1, 1e-5},
            {"tensor", d.tensor, 1e-4},
            {"normal_deg", d.normal_deg, 0.1}};
}

}  // namespace tvsgs
