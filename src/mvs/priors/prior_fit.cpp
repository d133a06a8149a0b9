#include "mvs/priors/prior_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "core/math/quantile.h"
#include "core/math/rng.h"

namespace tvsgs {
namespace {

/// scale * x + shift ~ y. An error of y times `unit` is the relative error of depth.
struct Equation {
    double x, y, unit;
};
using Equations = std::vector<Equation>;

Equations equations_of(const PriorSamples& samples, const PriorReading& reading) {
    Equations out;
    out.reserve(samples.size());
    for (const PriorSample& s : samples) {
        const double d = reading.geometry == PriorGeometry::ray ? s.distance : s.depth;
        if (reading.quantity == PriorQuantity::inverse_depth)
            out.push_back({s.value, 1 / d, d});
        else if (reading.quantity == PriorQuantity::log_depth)
            out.push_back({s.value, std::log(d), 1});
        else
            out.push_back({s.value, d, 1 / d});
    }
    return out;
}

double median_of(std::vector<double>& values) {
    return values.empty() ? std::numeric_limits<double>::infinity() : middle_of(values);
}

struct Line {
    double scale, shift;
};

double median_error(const Equations& equations, Line line, std::vector<double>& scratch) {
    scratch.clear();
    for (const Equation& e : equations)
        scratch.push_back(std::abs((line.scale * e.x + line.shift - e.y) * e.unit));
    return median_of(scratch);
}

/// The numbers to find.
struct Unknowns {
    bool scale, shift;
};

Unknowns unknowns_of(const PriorReading& reading) {
    const bool log = reading.quantity == PriorQuantity::log_depth;
    if (reading.alignment == PriorAlignment::affine) return {true, true};
    if (reading.alignment != PriorAlignment::scale) return {false, false};
    return {!log, log};
}

/// Weighted least squares, about the mean to avoid cancellation.
Line weighted_line(const Equations& equations,
                   const std::vector<double>& weights,
                   Unknowns unknown,
                   Line from) {
    double sum = 0, mean_x = 0, mean_y = 0;
    for (std::size_t i = 0; i < equations.size(); ++i) {
        sum += weights[i];
        mean_x += weights[i] * equations[i].x, mean_y += weights[i] * equations[i].y;
    }
    if (!(sum > 0)) return from;
    mean_x /= sum, mean_y /= sum;
    if (!unknown.scale) return {from.scale, mean_y - from.scale * mean_x};
    const double x0 = unknown.shift ? mean_x : 0, y0 = unknown.shift ? mean_y : 0;
    double xx = 0, xy = 0;
    for (std::size_t i = 0; i < equations.size(); ++i) {
        const double x = equations[i].x - x0, y = equations[i].y - y0;
        xx += weights[i] * x * x, xy += weights[i] * x * y;
    }
    if (!(xx > 0)) return from;
    const double scale = xy / xx;
    return {scale, unknown.shift ? mean_y - scale * mean_x : from.shift};
}

/// Fit by medians; for two unknowns by mean absolute deviations (3DGS).
Line median_line(const Equations& equations, Unknowns unknown) {
    std::vector<double> x, y, ratio, offset;
    for (const Equation& e : equations) {
        x.push_back(e.x), y.push_back(e.y);
        if (e.x != 0) ratio.push_back(e.y / e.x);
        offset.push_back(e.y - e.x);
    }
    if (!unknown.shift) return {median_of(ratio), 0};
    if (!unknown.scale) return {1, median_of(offset)};
    const double middle_x = median_of(x), middle_y = median_of(y);
    double spread_x = 0, spread_y = 0;
    for (const Equation& e : equations)
        spread_x += std::abs(e.x - middle_x), spread_y += std::abs(e.y - middle_y);
    const double scale = spread_y / spread_x;
    return {scale, middle_y - scale * middle_x};
}

/// Start with the smallest median error over at most 300 equations, which suffice.
Line first_line(const Equations& equations, Unknowns unknown) {
    constexpr std::size_t kMost = 300;
    constexpr std::uint64_t kTries = 100;
    Equations some;
    const std::size_t stride = 1 + equations.size() / kMost;
    for (std::size_t i = 0; i < equations.size(); i += stride) some.push_back(equations[i]);
    std::vector<double> scratch;
    Line best = median_line(equations, unknown);
    double least = median_error(some, best, scratch);
    if (!(least < std::numeric_limits<double>::infinity())) least = 1e300;
    const auto pick = [&some](std::uint32_t bits) {
        return some[static_cast<std::size_t>(static_cast<double>(uniform(bits)) *
                                             static_cast<double>(some.size()))];
    };
    for (std::uint64_t i = 0; i < kTries; ++i) {
        const Random4 random = random4(0, RandomStream::ransac, i);
        const Equation a = pick(random.v[0]), b = pick(random.v[1]);
        Line line{1, 0};
        if (unknown.scale && unknown.shift) {
            line.scale = (a.y - b.y) / (a.x - b.x);
            line.shift = a.y - line.scale * a.x;
        } else if (unknown.scale) {
            line.scale = a.y / a.x;
        } else {
            line.shift = a.y - a.x;
        }
        if (!(line.scale > 0 && std::isfinite(line.scale) && std::isfinite(line.shift))) continue;
        const double error = median_error(some, line, scratch);
        if (error < least) best = line, least = error;
    }
    return best;
}

Line refine(const Equations& equations, Unknowns unknown, Line line) {
    constexpr int kRounds = 10;
    constexpr double kHuber = 1.345, kCut = 6;  // standard deviations
    std::vector<double> scratch, weights(equations.size());
    for (int round = 0; round < kRounds; ++round) {
        const double deviation = std::max(1.4826 * median_error(equations, line, scratch), 1e-12);
        for (std::size_t i = 0; i < equations.size(); ++i) {
            const Equation& e = equations[i];
            const double error =
                std::abs((line.scale * e.x + line.shift - e.y) * e.unit) / deviation;
            const double robust = error < kHuber ? 1 : error < kCut ? kHuber / error : 0;
            weights[i] = robust * e.unit * e.unit;
        }
        line = weighted_line(equations, weights, unknown, line);
    }
    return line;
}

/// True if the spread of the values exceeds rounding. Relative, in squares.
bool varies(const Equations& equations) {
    double mean = 0, spread = 0;
    const auto count = static_cast<double>(equations.size());
    for (const Equation& e : equations) mean += e.x / count;
    for (const Equation& e : equations) spread += (e.x - mean) * (e.x - mean) / count;
    return spread > 1e-6 * mean * mean;
}

}  // namespace

double prior_depth(double value, const PriorFit& fit, const PriorReading& reading, double cosine) {
    const double number = fit.scale * value + fit.shift;
    const double d = reading.quantity == PriorQuantity::log_depth       ? std::exp(number)
                     : reading.quantity == PriorQuantity::inverse_depth ? 1 / number
                                                                        : number;
    const double z = reading.geometry == PriorGeometry::ray ? d * cosine : d;
    return z > 0 && z < 1e30 ? z : 0;
}

PriorFit fit_prior(const PriorSamples& samples, const PriorReading& reading) {
    PriorFit fit;
    Unknowns unknown = unknowns_of(reading);
    if (samples.size() < (unknown.scale && unknown.shift ? kFewestForShift : kFewestForScale))
        return fit;
    const Equations equations = equations_of(samples, reading);
    if (unknown.scale && unknown.shift && !varies(equations))
        (reading.quantity == PriorQuantity::log_depth ? unknown.scale : unknown.shift) = false;
    Line line{1, 0};
    if (unknown.scale || unknown.shift)
        line = refine(equations, unknown, first_line(equations, unknown));
    if (!(line.scale > 0 && std::isfinite(line.scale) && std::isfinite(line.shift))) return fit;
    fit.found = true, fit.scale = line.scale, fit.shift = line.shift;
    std::vector<double> errors;
    for (const PriorSample& s : samples)
        errors.push_back(
            std::abs(prior_depth(s.value, fit, reading, s.depth / s.distance) / s.depth - 1));
    fit.residual = median_of(errors);
    std::vector<double> depths;
    for (const PriorSample& s : samples) depths.push_back(s.depth);
    const double middle = median_of(depths);
    errors.clear();
    for (const PriorSample& s : samples) errors.push_back(std::abs(middle / s.depth - 1));
    fit.residual_of_constant = median_of(errors);
    return fit;
}

double rank_correlation(const PriorSamples& samples) {
    if (samples.size() < 3) return 0;
    const auto ranks = [&](const auto& key) {
        std::vector<std::size_t> order(samples.size());
        std::iota(order.begin(), order.end(), std::size_t{0});
        std::ranges::sort(
            order, [&](std::size_t a, std::size_t b) { return key(samples[a]) < key(samples[b]); });
        std::vector<double> rank(samples.size());
        for (std::size_t i = 0; i < order.size();) {
            std::size_t end = i + 1;  // equal values share their mean rank
            while (end < order.size() && key(samples[order[end]]) == key(samples[order[i]])) ++end;
            for (std::size_t k = i; k < end; ++k)
                rank[order[k]] = 0.5 * static_cast<double>(i + end - 1);
            i = end;
        }
        return rank;
    };
    const std::vector<double> a = ranks([](const PriorSample&s) { return s.value; }),
                              b = ranks([](const PriorSample&s) { return s.depth; });
    const double mean = 0.5 * static_cast<double>(samples.size() - 1);
    double aa = 0, bb = 0, ab = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        aa += (a[i] - mean) * (a[i] - mean), bb += (b[i] - mean) * (b[i] - mean);
        ab += (a[i] - mean) * (b[i] - mean);
    }
    return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

}  // namespace tvsgs
