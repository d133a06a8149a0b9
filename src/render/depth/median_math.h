// Median depth of a ray: the depth at which half of the light is absorbed. Splats are solids: each
// absorbs light up to its centre and none behind.  [GGGS, Section 3]; formulas:
// docs/method/depth.md
//
// A splat with alpha a and profile g(t) = a exp(-(t - t_i)^2 / 2 s^2) transmits T_i = sqrt(1 - g)
// in front of its centre and (1 - a) / sqrt(1 - g) behind it. T is the product over the splats, in
// any order.
#pragma once

#include "render/rade/ray_profile_math.h"

namespace tvsgs {

/// Cut-off of profiles, in deviations: g is 0 beyond. All passes use it, so that no pass depends on
/// the splats that another pass skips. T_i jumps by less than 2e-4 there.
inline constexpr float kProfileReach = 4;

inline constexpr float kMedianSquare = 0.25f;  // of T

/// exp(-x^2 / 2) with the cut-off.
template <class Real>
TVSGS_HD Real profile(Real x) {
    using std::abs;
    return abs(x) < Real(kProfileReach) ? FastMath::decay(Real(0.5) * (x * x)) : Real(0);
}

/// T_i^2 at x = (t - t_i) / s.
template <class Real>
TVSGS_HD Real squared_transmittance(Real alpha, Real x) {
    const Real open = 1 - alpha * profile(x), rest = 1 - alpha;
    return x > 0 ? rest * rest * FastMath::inverse(open) : open;
}

/// Derivatives of ln T_i.
template <class Real>
struct TransmittanceGradients {
    Real by_alpha, by_depth;  // by_depth: by t; the derivative by t_i is its negative
    Real by_square;           // by 1/s^2
};
template <class Real>
TVSGS_HD TransmittanceGradients<Real> log_transmittance_vjp(Real alpha,
                                                            Real x,
                                                            Real deviation,
                                                            Real inverse) {
    const Real e = profile(x), half = FastMath::inverse(1 - alpha * e) * Real(0.5);
    const bool behind = x > 0;
    const Real by_g = behind ? half : -half, y = -by_g * (alpha * e) * x;
    return {by_g * e - (behind ? FastMath::inverse(1 - alpha) : Real(0)), y * inverse,
            Real(0.5) * y * x * (deviation * deviation)};
}

/// The splats that count for a pixel's depth: the blended ones in blending order, up to the first
/// behind which T is below this value, and at most kDepthSplats. All passes use these limits. Later
/// splats contribute almost nothing to the colour either, and would double the cost.
inline constexpr float kDepthTransmittance = 0.05f;
inline constexpr int kDepthSplats = 32;

/// Extent of these splats along the ray.
template <class Real>
struct MedianRange {
    int count = 0;
    Real T = 1;                                     // behind all of them
    Real from = Real(3e38), to = Real(-3e38);       // bounds of their profiles
    Real first = 0, weight = 0, sum = 0, sum2 = 0;  // moments by blending weights

    TVSGS_HD bool complete() const {
        return T < Real(kDepthTransmittance) || count == kDepthSplats;
    }

    /// Adds the next splat of the list. Alpha 0 changes nothing. Returns false if the splat does
    /// not count.
    TVSGS_HD bool add(Real alpha, const RayPoint<Real>& point) {
        if (!(alpha > 0) || complete()) return false;
        const Real reach = Real(kProfileReach) * point.deviation;
        from = point.depth - reach < from ? point.depth - reach : from;
        to = point.depth + reach > to ? point.depth + reach : to;
        if (weight == 0) first = point.depth;
        const Real w = T * alpha, d = point.depth - first;
        weight += w, sum += w * d, sum2 += w * (d * d + point.deviation * point.deviation);
        T *= 1 - alpha;
        ++count;
        return true;
    }
};

/// Search for the depth at which T^2 is a quarter; T^2 falls along the ray. The caller evaluates
/// all points at once, because walking the list is the expensive part.
template <class Real>
struct MedianSearch {
    static constexpr int kPoints = 8;
    static constexpr int kMostTurns = 24;  // each leaves at most 0.4 of the range

    Real low = 0, high = 0;        // bounds of the median
    Real at_low = 1, at_high = 1;  // T^2 at the bounds
    Real points[kPoints] = {};

    /// Returns false if there is no median. Most medians lie slightly in front of the weights'
    /// mean.
    TVSGS_HD bool start(const MedianRange<Real>& range) {
        if (!(range.T <= Real(0.5)) || !(range.to > 0)) return false;
        low = range.from > 0 ? range.from : Real(0), high = range.to, at_high = range.T * range.T;
        const Real mean = range.sum / range.weight,
                   square = range.sum2 / range.weight - mean * mean;
        const Real deviation = std::sqrt(square > 0 ? square : Real(0));
        constexpr float kSteps[kPoints] = {-2.2f, -1.4f, -0.9f, -0.5f, -0.15f, 0.25f, 0.8f, 1.8f};
        for (int k = 0; k < kPoints; ++k)
            points[k] = range.first + mean + Real(kSteps[k]) * deviation;
        return true;
    }

    /// Narrows the bounds by T^2 at the points and sets new points.
    TVSGS_HD void narrow(const Real (&square)[kPoints]) {
        for (int k = 0; k < kPoints; ++k) {
            const bool inside = !(points[k] <= low) && points[k] < high;
            const bool above = square[k] > Real(kMedianSquare);
            if (inside && above) low = points[k], at_low = square[k];
            if (inside && !above) high = points[k], at_high = square[k];
        }
        // Points around the place where a uniform fall of ln T predicts the median, and two far
        // ones.
        const Real width = high - low, fall = std::log(at_low / at_high),
                   share = std::log(at_low / Real(kMedianSquare)) / fall;
        constexpr float kSteps[kPoints - 2] = {-0.15f, -0.04f, -0.01f, 0.01f, 0.04f, 0.15f};
        for (int k = 0; k < kPoints - 2; ++k) points[k] = low + (share + Real(kSteps[k])) * width;
        points[kPoints - 2] = low + Real(0.3) * width;
        points[kPoints - 1] = low + Real(0.7) * width;
    }

    /// True if T changes by at most 0.2 % between the bounds, or depth by almost nothing.
    TVSGS_HD bool done() const {
        return high - low <= Real(1e-6) * high || at_low <= Real(1.004) * at_high;
    }
    /// False if half of the light is absorbed before depth 0.
    TVSGS_HD bool found() const { return done() && low > 0; }

    /// Linear interpolation between the bounds.
    TVSGS_HD Real median() const {
        const Real share = (at_low - Real(kMedianSquare)) / (at_low - at_high);
        return low + share * (high - low);
    }
    /// d ln T / dt between the bounds.
    TVSGS_HD Real slope() const { return Real(0.5) * std::log(at_high / at_low) / (high - low); }
};

/// Runs the search; look(points, squares) must compute T^2. Returns false if there is no median.
template <class Real, class Look>
TVSGS_HD bool find_median(const MedianRange<Real>& range,
                          const Look& look,
                          MedianSearch<Real>& search) {
    if (!search.start(range)) return false;
    for (int turn = 0; turn < search.kMostTurns && !search.done(); ++turn) {
        Real squares[MedianSearch<Real>::kPoints];
        look(search.points, squares);
        search.narrow(squares);
    }
    return search.found();
}

/// dL/d(ln T at the median) of all splats together. slope: d ln T / dt, negative. Zero if the slope
/// is almost 0: then the median has no derivative.
template <class Real>
TVSGS_HD Real median_vjp(Real depth, Real slope, Real dL_ddepth) {
    return slope * depth < Real(-1e-6) ? -dL_ddepth / slope : Real(0);
}

}  // namespace tvsgs
