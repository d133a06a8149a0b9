#include "bench_case.h"

#include <optional>

#include "core/error.h"
#include "core/rng.h"

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

/// How far list `mine` of splat i is from a right one, however ties of either distance resolve: no
/// member may lie beyond the 2k-th Euclidean neighbour, and no nearer splat may be left out that is
/// nearer in the whitened space than the list's last.
double list_error(const VotingCase& c,
                  const WhitenedDistance& distance,
                  int i,
                  const std::vector<std::uint32_t>& mine) {
    const std::uint32_t self = static_cast<std::uint32_t>(i);
    std::vector<double> reach(std::size_t(c.size()));
    for (std::uint32_t j = 0; j < reach.size(); ++j)
        reach[j] =
            norm(vec_cast<double>(c.splats.means[j]) - vec_cast<double>(c.splats.means[self]));
    std::vector<double> sorted = reach;
    const auto last =
        sorted.begin() + std::min(2 * std::ptrdiff_t(c.options.k), std::ptrdiff_t(c.size()) - 1);
    reach[self] = -1;  // not its own neighbour: rank 0
    sorted[self] = -1;
    std::nth_element(sorted.begin(), last, sorted.end());
    const double limit = *last;
    const auto beyond = [](double value, double bound) {
        return value <= bound ? 0 : bound > 0 ? value / bound - 1 : 1;
    };
    double error = 0, farthest = 0;
    for (const auto j : mine) {
        error = std::max(error, j == self ? 1 : beyond(reach[j], limit));
        farthest = std::max(farthest, distance(i, j));
    }
    for (std::uint32_t j = 0; j < reach.size(); ++j)
        if (j != self && reach[j] < limit * (1 - 1e-6) &&
            !std::binary_search(mine.begin(), mine.end(), j))
            error = std::max(error, beyond(farthest, distance(i, j)));
    return error;
}

void compare_lists(const VotingCase& c, const VotingDetails& details, CaseDifferences& out) {
    const WhitenedDistance distance(c);
    for (int i = 0; i < c.size(); ++i) {
        const auto mine = sorted_row(details.receivers, c.k, i),
                   oracles = sorted_row(c.receivers, c.k, i);
        if (mine == oracles) continue;
        ++out.lists_with_ties;
        const bool twice = std::adjacent_find(mine.begin(), mine.end()) != mine.end();
        out.list = std::max(out.list, twice ? 1 : list_error(c, distance, i, mine));
    }
}

/// The oracle counts votes of weight 0 from splats that no vote has reached; these do not vote.
bool heard_from_tensorless(const FieldOnHost& f, int i) {
    for (auto e = f.details.begin[std::size_t(i)]; e < f.details.begin[std::size_t(i) + 1]; ++e)
        if ((f.flags[f.details.voters[std::size_t(e)]] & kHasTensor) == 0) return true;
    return false;
}

/// Per splat, how far a unit in the last place of the inputs moves the results in double: the error
/// that no computation in float can be blamed for.
struct Conditioning {
    std::vector<double> tensor, normal_deg;  // largest of a few draws; the first absolute
};
constexpr int kDraws = 4;
constexpr double kSlack = 10;  // of so few draws the largest is below the worst case

Gaussians<Cpu> moved(const Gaussians<Cpu>& splats, std::uint32_t draw) {
    Gaussians<Cpu> result;
    copy(splats, result);
    std::uint64_t index = 0;
    const auto move = [&](float& x) {
        x *= 1 + 1.2e-7f * (uniform(random4(0, RandomStream::test, index++, draw).v[0]) - 0.5f);
    };
    const auto move3 = [&](Vec3f& v) { move(v.x), move(v.y), move(v.z); };
    for (int i = 0; i < splats.size(); ++i) {
        const std::size_t s = std::size_t(i);
        Quatf& q = result.quats[s];
        move3(result.means[s]), move3(result.log_scales[s]);
        move(q.w), move(q.x), move(q.y), move(q.z);
    }
    return result;
}

Conditioning conditioning(const VotingCase& c) {
    TvOptions exact = c.options;
    exact.precision = VotePrecision::double_precision;
    const std::size_t count = std::size_t(c.size());
    const FieldOnHost here = run_events(c.splats, exact, c.rounds, c.receivers);
    Conditioning result{std::vector<double>(count), std::vector<double>(count)};
    for (std::uint32_t draw = 0; draw < kDraws; ++draw) {
        const FieldOnHost there = run_events(moved(c.splats, draw), exact, c.rounds, c.receivers);
        for (std::size_t s = 0; s < count; ++s) {
            result.tensor[s] = std::max(result.tensor[s],
                                        frobenius(difference(here.tensors[s], there.tensors[s])));
            result.normal_deg[s] =
                std::max(result.normal_deg[s], angle_deg(here.normals[s], there.normals[s]));
        }
    }
    return result;
}

void compare_field(const VotingCase& c, const FieldOnHost& f, CaseDifferences& out) {
    const int count = c.size();
    std::optional<Conditioning> moves;
    const auto moves_of = [&]() -> const Conditioning& {
        if (!moves) moves = conditioning(c);
        return *moves;
    };
    std::vector<double> sizes, gaps;
    for (int i = 0; i < count; ++i) {
        sizes.push_back(frobenius(sym(c.at("tensor"), i)));
        gaps.push_back(relative_gap(vec_cast<float>(vec(c.at("eigenvalues"), i))));
    }
    // A tensor far below the others is made of votes in the exponential's tail, where a rounding
    // error of the inputs (scales are stored as logarithms) grows by a factor of up to 50.
    const double least = 0.01 * middle(sizes);
    const auto widen = [](double& largest, double value) {
        const bool wider = !(value <= largest);  // NaN stays
        if (wider) largest = value;
        return wider;
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
        const double size = std::max(sizes[s], least);
        const double off_tensor = frobenius(difference(f.tensors[s], oracle)) / size;
        const double off_normal = gaps[s] > kComparedGap ? angle_deg(vec_cast<double>(f.normals[s]),
                                                                     vec(c.at("normal"), i))
                                                         : 0;
        if ((off_tensor > kTensorBound && off_tensor <= kSlack * moves_of().tensor[s] / size) ||
            (off_normal > kNormalBoundDeg && off_normal <= kSlack * moves_of().normal_deg[s])) {
            ++out.excused;
            continue;
        }
        if (widen(out.tensor, off_tensor)) out.tensor_at = i;
        if (widen(out.normal_deg, off_normal)) out.normal_at = i;
        out.flags += ((f.flags[s] & kNormalValid) != 0) != (gaps[s] >= kMinNormalGap);
        if (!heard_from_tensorless(f, i))
            widen(out.strength, std::abs(f.details.strength[s] / strength - 1));
        if (!(gaps[s] > kComparedGap)) continue;

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
    out.splats = c.size();
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
            {"tensor", d.tensor, kTensorBound},
            {"normal_deg", d.normal_deg, kNormalBoundDeg},
            // A few votes only, or from far outliers, make for badly conditioned sums; in a trained
            // scene there are next to none.
            {"excused_share", double(d.excused) / std::max(d.splats, 1), 0.05}};
}

}  // namespace tvsgs
