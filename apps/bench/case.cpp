#include "apps/bench/case.h"

#include <string_view>

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
        const auto w = whitening(quat_cast<double>(case_.splats.quats[i]), scale(case_, i), rule_,
                                 kWhitenNoise * mean_trace_);
        const Vec3<double> d =
            vec_cast<double>(case_.splats.means[j]) - vec_cast<double>(case_.splats.means[i]);
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
        if (j != self && reach[j] < limit * (1 - 1e-6) && !std::ranges::binary_search(mine, j))
            error = std::max(error, beyond(farthest, distance(i, j)));
    return error;
}

class Comparer {
public:
    explicit Comparer(const VotingCase& c, CaseComparison& out)
        : case_(c), out_(out), excused_(std::size_t(c.size())) {}

    void lists(const VotingDetails& details) {
        const WhitenedDistance distance(case_);
        CaseQuantity& list = quantity("list", 1e-5, 1e-5);  // ties in float distances
        for (int i = 0; i < case_.size(); ++i) {
            const auto mine = sorted_row(details.receivers, case_.k, i),
                       oracles = sorted_row(case_.receivers, case_.k, i);
            const bool same = mine == oracles;
            out_.lists_with_ties += same ? 0 : 1;
            const bool twice = std::adjacent_find(mine.begin(), mine.end()) != mine.end();
            list.add(i, same ? 0 : twice ? 1 : list_error(case_, distance, i, mine), 0, excused_);
        }
    }

    void field(const FieldOnHost& f) {
        numbers("tau", f.details.tau, 1e-5, 1e-3, 0, false);
        tensors(f);
        normals(f);
        targets(f);
        numbers("variability", f.details.variability, 0.1 * kPi / 180, 3 * kPi / 180, -1, true);
        numbers("strength", f.details.strength, 1e-3, 0.1, 0.01, true);
        flag("has_tensor", [&](std::size_t i) { return (f.flags[i] & kHasTensor) != 0; });
        flag("normal_valid", [&](std::size_t i) { return (f.flags[i] & kNormalValid) != 0; });
        flag("position_valid", [&](std::size_t i) { return (f.flags[i] & kPositionValid) != 0; });
        flag("left_out", [&](std::size_t i) { return f.details.left_out[i] != 0; });
        out_.excused = static_cast<int>(std::ranges::count(excused_, true));
    }

private:
    /// The result stays valid: compare_with_case() has reserved room for all.
    CaseQuantity& quantity(const char* name, double bound, double ceiling) {
        return out_.quantities.emplace_back(CaseQuantity{name, bound, ceiling});
    }
    double stored(const char* array, int i) const { return case_.at(array).numbers[i]; }
    /// Whether splat i has no result to compare, or one that rounding decides, which is counted.
    bool skips(CaseQuantity& result, int i, bool unambiguous_only) const {
        const double has = stored("has_tensor", i);
        if (has == 2) ++result.defined;
        return has != 1 || (unambiguous_only && stored("normal_valid", i) != 1);
    }
    /// (lambda_2 - lambda_3) / lambda_1.
    double gap(int i) const {
        const Vec3<double> l = vec(case_.at("eigenvalues"), i);
        return l.x > 0 ? (l.y - l.z) / l.x : 0;
    }

    /// `least`: differences are relative to a number, or to this share of the middle one if that is
    /// more; below zero: absolute.
    void numbers(const char* name,
                 const std::vector<float>& mine,
                 double bound,
                 double ceiling,
                 double least,
                 bool is_statistic) {
        CaseQuantity& result = quantity(name, bound, ceiling);
        const std::string moves = str("moved_", name);
        const double middle_one = middle(case_.at(name).numbers);
        for (int i = 0; i < case_.size(); ++i) {
            // The two statistics of the mask are made of unambiguous normals only.
            if (skips(result, i, is_statistic)) continue;
            const double wanted = stored(name, i);
            double unit = least < 0 ? 1 : std::max(std::abs(wanted), least * middle_one);
            if (unit == 0) unit = 1;
            result.add(i, std::abs(double(mine[i]) - wanted) / unit,
                       stored(moves.c_str(), i) / unit, excused_);
        }
    }

    void tensors(const FieldOnHost& f) {
        CaseQuantity& result = quantity("tensor", kTensorBound, 0.02);
        std::vector<double> sizes;
        for (int i = 0; i < case_.size(); ++i)
            sizes.push_back(frobenius(sym(case_.at("tensor"), i)));
        const double least = 0.01 * middle(sizes);  // one far below the others counts with these
        for (int i = 0; i < case_.size(); ++i) {
            if (skips(result, i, false)) continue;
            const double size = std::max(sizes[i], least);
            const Sym3f off = difference(f.tensors[i], sym(case_.at("tensor"), i));
            result.add(i, frobenius(off) / size, stored("moved_tensor", i) / size, excused_);
        }
    }

    void normals(const FieldOnHost& f) {
        CaseQuantity& result = quantity("normal_deg", kNormalBoundDeg, 5);
        for (int i = 0; i < case_.size(); ++i) {
            if (skips(result, i, true)) continue;
            // The same error of a tensor turns its normal farther the smaller the gap is.
            const double share = std::min(1.0, gap(i) / kComparedGap);
            const double off =
                angle_deg(vec_cast<double>(f.normals[i]), vec(case_.at("normal"), i));
            result.add(i, share * off, stored("moved_normal_deg", i) * share, excused_);
        }
    }

    /// A target is one of eleven places on the voted normal, as salient as the oracle's.
    void targets(const FieldOnHost& f) {
        CaseQuantity &place = quantity("target_steps", 0.02, 0.02),
                     &saliency = quantity("target_saliency", 1e-4, 1e-2);
        for (int i = 0; i < case_.size(); ++i) {
            if (skips(place, i, true) || !(gap(i) > kComparedGap)) continue;
            const Vec3<double> scales = scale(case_, i), mean = vec(case_.at("means"), i),
                               normal = vec(case_.at("normal"), i),
                               target = vec(case_.at("target"), i);
            const double step = double(case_.options.virtual_range) *
                                std::max({scales.x, scales.y, scales.z}) / kSteps;
            const Vec3<double> offset = vec_cast<double>(f.targets[i]) - mean;
            // Less what storing a point as floats rounds away; which may be all there is.
            const double rounding = norm(mean) * 1.1e-7;
            if (step < 2 * rounding) {
                place.add(i, std::max(norm(offset) - kSteps * step - rounding, 0.0) / step, 0,
                          excused_);
                continue;
            }
            const double along_mine = dot(offset, normal) / step,
                         along_oracles = dot(target - mean, normal) / step;
            const auto is_place = [](double along) { return std::abs(along) < kSteps + 0.5; };
            if (!is_place(along_mine) || !is_place(along_oracles)) {
                place.add(i, std::abs(along_mine - along_oracles) + kSteps, 0, excused_);
                continue;
            }
            const int chosen = static_cast<int>(std::lround(along_mine)),
                      wanted = static_cast<int>(std::lround(along_oracles));
            const Vec3<double> at = chosen == wanted ? target - mean : chosen * step * normal;
            const double off = norm(offset - at) - rounding;
            place.add(i, std::max(off, 0.0) / step, 0, excused_);
            if (stored("target_decided", i) == 2) {
                ++saliency.defined;
                continue;
            }
            const double* all = &case_.at("saliency").numbers[std::size_t(i) * (2 * kSteps + 1)];
            saliency.add(i, std::abs(all[place_of(wanted)] - all[place_of(chosen)]),
                         stored("moved_saliency", i), excused_);
        }
    }
    static constexpr int kSteps = 5;
    /// In the oracle's order: 0, -1, 1, -2, 2, ...
    static int place_of(int m) { return m == 0 ? 0 : 2 * std::abs(m) - (m < 0 ? 1 : 0); }

    template <class Mine>
    void flag(const char* array, const Mine& mine) {
        CaseQuantity& result = quantity(array, 0, 0);
        for (int i = 0; i < case_.size(); ++i) {
            const double wanted = stored(array, i);
            if (wanted == 2)
                ++result.defined;
            else
                result.add(i, mine(std::size_t(i)) == (wanted == 1) ? 0 : 1, 0, excused_);
        }
    }

    const VotingCase& case_;
    CaseComparison& out_;
    std::vector<bool> excused_;
};

}  // namespace

void CaseQuantity::add(int splat,
                       double difference,
                       double moved,
                       std::vector<bool>& excused_splats) {
    constexpr double kSlack = 10;  // of few draws the largest is below the worst case
    ++defined, ++compared;
    const double limit = std::min(kSlack * moved, ceiling);
    if (difference > bound && difference <= limit) {
        ++excused;
        excused_splats[splat] = true;
    } else if (!(difference <= largest) && !std::isnan(largest)) {
        largest = difference, at = splat;
    }
}

std::string CaseQuantity::fault() const {
    if (!(largest <= bound))
        return str(name, " of splat ", at, " differs by ", largest, ", allowed ", bound);
    // Coordinates may be too coarse to tell any two targets apart.
    const bool may_be_empty = std::string_view(name) == "target_saliency";
    if (compared < kComparedShare * defined || (defined == 0 && !may_be_empty))
        return str(name, " can be compared in ", compared, " of ", defined, " splats, expected ",
                   100 * kComparedShare, " %");
    return {};
}

std::vector<std::string> CaseComparison::faults() const {
    if (!same_length) return {"the lists and the lists of the oracle differ in length"};
    std::vector<std::string> list;
    for (const CaseQuantity& q : quantities)
        if (std::string text = q.fault(); !text.empty()) list.push_back(std::move(text));
    if (excused > kExcusedShare * splats)
        list.push_back(str(excused, " of ", splats, " splats exceed a bound by rounding, allowed ",
                           100 * kExcusedShare, " %"));
    return list;
}

VotingCase read_voting_case(const std::string& path) {
    VotingCase c;
    c.name = path;
    c.arrays = read_npz(path);
    const std::vector<std::int64_t>& shape = c.at("means").shape;
    const std::int64_t count = shape.empty() ? 0 : shape[0];
    const auto expect_shape = [&](const char* name, std::vector<std::int64_t> wanted) {
        if (c.at(name).shape != wanted || c.at(name).is_text)
            throw Error(ExitCode::input, path, ": array '", name, "' has a wrong shape for ", count,
                        " splats; expected a case of the oracle, from "
                        "tests/data/tensor_voting/tensor_voting.py --make");
    };
    if (c.at("index").shape.size() == 2) c.k = static_cast<int>(c.at("index").shape[1]);
    if (count < 2 || count > 10'000'000 || c.k < 1)
        throw Error(ExitCode::input, path, ": ", count, " splats with lists of ", c.k,
                    "; expected a case of the oracle, tensor_voting.py --make");
    for (const char* name : {"means", "scales", "eigenvalues", "normal", "target"})
        expect_shape(name, {count, 3});
    for (const char* name :
         {"tau", "variability", "strength", "left_out", "has_tensor", "normal_valid",
          "position_valid", "target_decided", "moved_tau", "moved_tensor", "moved_normal_deg",
          "moved_saliency", "moved_variability", "moved_strength"})
        expect_shape(name, {count});
    for (const char* name : {"k", "rounds", "whiten", "flatness_limit", "flatness_limit_position",
                             "virtual_range", "target_margin", "max_vote_angle_deg", "min_votes"})
        expect_shape(name, {});
    expect_shape("saliency", {count, 11});
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
            throw Error(ExitCode::input, path, ": array 'index' names splat ", j, " of ", count);
        c.receivers.push_back(static_cast<std::uint32_t>(j));
    }
    c.options.k = static_cast<int>(number("k"));
    c.rounds = static_cast<int>(number("rounds"));
    if (c.options.k < 1 || c.rounds < 1)
        throw Error(ExitCode::input, path, ": k ", number("k"), ", rounds ", number("rounds"),
                    "; expected 1 or more");
    const auto says = [&](const char* name, const char* usual, const char* choice) {
        const std::string& text = c.at(name).text;
        if (text != usual && text != choice)
            throw Error(ExitCode::input, path, ": '", name, "' is '", text, "'; expected ", usual,
                        " or ", choice);
        return text == choice;
    };
    TvOptions& o = c.options;
    o.whiten = number("whiten") != 0;
    for (const auto& [name, value] : {std::pair("flatness_limit", &o.flatness_limit),
                                      {"flatness_limit_position", &o.flatness_limit_position},
                                      {"virtual_range", &o.virtual_range},
                                      {"target_margin", &o.target_margin},
                                      {"max_vote_angle_deg", &o.max_vote_angle_deg}})
        *value = static_cast<float>(number(name));
    o.min_votes = static_cast<int>(number("min_votes"));
    if (says("mode", "global", "per_splat")) o.whiten_noise_mode = NoiseMode::per_splat;
    if (says("vote_map", "covariant", "unit")) o.vote_map = VoteMap::unit;
    if (says("scale_rule", "ten_percent_at_median", "median")) o.scale_rule = ScaleRule::median;
    if (says("curvature", "literal", "scale_free")) o.curvature = Curvature::scale_free;
    if (says("strength_rule", "relative", "literal")) o.strength = VoteStrength::literal;
    return c;
}

CaseComparison compare_with_case(const VotingCase& c, const RunCase& run) {
    FieldOnHost field = run({});
    CaseComparison out;
    out.splats = c.size();
    out.same_length = field.details.k == c.k;
    if (!out.same_length) return out;
    out.quantities.reserve(16);  // they are referred to while others are added
    Comparer compare(c, out);
    compare.lists(field.details);
    if (out.lists_with_ties > 0) field = run(c.receivers);
    compare.field(field);
    return out;
}

}  // namespace tvsgs
