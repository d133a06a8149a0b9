// The depth at which half of a ray's light has been taken away, by splats as solids: each takes
// light on the way in and none on the way out.  [GGGS, Section 3]; the formulas:
// docs/method/depth.md
//
// A splat of alpha a and profile g(t) = a exp(-(t - t_i)^2 / 2 s^2) lets through T_i = sqrt(1 - g)
// before its centre and (1 - a) / sqrt(1 - g) behind; T is the product, whatever the order.
#pragma once

#include "render/ray_profile_math.h"

namespace tvsgs {

/// Profiles end here, in deviations: g is 0 beyond. Every pass goes by it, so that none depends on
/// which splats another one leaves out; T_i jumps by less than 2e-4 there.
inline constexpr float kProfileReach = 4;

inline constexpr float kMedianSquare = 0.25f;  // of T

/// exp(-x^2 / 2), cut off.
template <class Real>
TVSGS_HD Real profile(Real x) {
    using std::abs;
    return abs(x) < Real(kProfileReach) ? FastMath::decay(Real(0.5) * (x * x)) : Real(0);
}

/// T_i^2 at x = (t - t_i) / s.
template <class Real>
TVSGS_HD Real passed_square(Real alpha, Real x) {
    const Real open = 1 - alpha * profile(x), rest = 1 - alpha;
    return x > 0 ? rest * rest * FastMath::inverse(open) : open;
}

/// Derivatives of ln T_i.
template <class Real>
struct PassedGradients {
    Real by_alpha, by_depth;  // by_depth: by t; by t_i it is the negative
    Real by_square;           // by 1/s^2
};
template <class Real>
TVSGS_HD PassedGradients<Real> passed_vjp(Real alpha, Real x, Real deviation, Real inverse) {
    const Real e = profile(x), half = FastMath::inverse(1 - alpha * e) * Real(0.5);
    const bool behind = x > 0;
    const Real by_g = behind ? half : -half, y = -by_g * (alpha * e) * x;
    return {by_g * e - (behind ? FastMath::inverse(1 - alpha) : Real(0)), y * inverse,
            Real(0.5) * y * x * (deviation * deviation)};
}

/// Where to look for a median, from the splats at the front of a list.
template <class Real>
struct MedianRange {
    Real T = 1, from = Real(3e38), to = Real(-3e38);
    Real guess = 0;  // depth of the last splat

    /// Below this T is below a half at `to`: profiles that end there leave less than 2 % more.
    TVSGS_HD bool complete() const { return T < Real(0.49); }

    /// The next splat of the list; of alpha 0 it changes nothing.
    TVSGS_HD void add(Real alpha, const RayPoint<Real>& point) {
        if (!(alpha > 0) || complete()) return;
        const Real reach = Real(kProfileReach) * point.deviation;
        from = point.depth - reach < from ? point.depth - reach : from;
        to = point.depth + reach > to ? point.depth + reach : to;
        guess = point.depth;
        T *= 1 - alpha;
    }
};

/// Looks for the depth at which T^2, which falls along the ray, is a quarter. The caller computes
/// it at all points at once, as walking a list is what costs.
template <class Real>
struct MedianSearch {
    static constexpr int kPoints = 8;
    static constexpr int kMostTurns = 12;

    Real low = 0, high = 0;         // the median is between these
    Real at_low = 1, at_high = -1;  // T^2; -1: never looked
    Real points[kPoints] = {};      // ascending

    /// Next to the guess first: it is near the median where blending's order is right.
    TVSGS_HD void start(const MedianRange<Real>& range) {
        using std::abs;
        const Real first = range.from > 0 ? range.from : Real(0), to = range.to;
        constexpr float kSteps[kPoints] = {0, -2e-2f, -2e-3f, -2e-4f, 2e-4f, 2e-3f, 2e-2f, 0};
        for (int k = 1; k < kPoints - 1; ++k) {
            const Real at = range.guess + abs(range.guess) * Real(kSteps[k]);
            points[k] = at < first ? first : at > to ? to : at;
        }
        points[0] = first, points[kPoints - 1] = to;
        high = to;
    }

    /// By T^2 at the points. False if it has been above a quarter everywhere: there is no median.
    TVSGS_HD bool narrow(const Real (&square)[kPoints]) {
        bool above = true;
        for (int k = 0; k < kPoints; ++k) {
            const bool here = above && square[k] > Real(kMedianSquare);
            if (here)
                low = points[k], at_low = square[k];
            else if (above)
                high = points[k], at_high = square[k];
            above = here;
        }
        return at_high >= 0;
    }

    /// T changes by 0.2 % at most, or depth by next to nothing.
    TVSGS_HD bool done() const {
        return high - low <= Real(1e-6) * high || at_low <= Real(1.004) * at_high;
    }
    /// Not where half of the light is taken before depth 0.
    TVSGS_HD bool found() const { return done() && low > 0; }
    TVSGS_HD void spread_points() {
        const Real step = (high - low) / (kPoints + 1);
        for (int k = 0; k < kPoints; ++k) points[k] = multiply_add(Real(k + 1), step, low);
    }

    /// On the straight line between the two.
    TVSGS_HD Real median() const {
        const Real share = (at_low - Real(kMedianSquare)) / (at_low - at_high);
        return low + share * (high - low);
    }
};

/// Runs the turns on a ray whose T^2 at a depth is square(depth). False if there is no median.
template <class Real, class Square>
bool find_median(const MedianRange<Real>& range, const Square& square, MedianSearch<Real>& search) {
    search.start(range);
    for (int turn = 0; turn < search.kMostTurns && !search.done(); ++turn) {
        Real squares[MedianSearch<Real>::kPoints];
        for (int k = 0; k < search.kPoints; ++k) squares[k] = square(search.points[k]);
        if (!search.narrow(squares)) return false;
        search.spread_points();
    }
    return search.found();
}

/// dL/d(ln T at the median), of all splats together; slope: d ln T / dt, below 0. Where that is
/// next to nothing the median has no derivative.
template <class Real>
TVSGS_HD Real median_vjp(Real depth, Real slope, Real dL_ddepth) {
    return slope * depth < Real(-1e-6) ? -dL_ddepth / slope : Real(0);
}

}  // namespace tvsgs
