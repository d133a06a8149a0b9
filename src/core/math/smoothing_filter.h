// Splats under a 3D smoothing filter: none is finer than what the photographs can show.  [Yu24]
#pragma once

#include "core/math/vec.h"

namespace tvsgs {

/// A splat convolved with a round Gaussian, its peak lowered as its volume grows.
template <class Real>
struct SmoothedSplat {
    Vec3<Real> scales;  // standard deviations, world units
    Vec3<Real> kept;    // these before over after, at most 1
    Real dimming;       // the factor on the opacity, the product of `kept`
};

/// `filter`: standard deviation of the Gaussian, world units; 0 changes nothing. The product goes
/// axis by axis: a root of two products of squares would underflow for flat splats.
template <class Real>
TVSGS_HD SmoothedSplat<Real> smoothed(Vec3<Real> log_scale, Real filter) {
    SmoothedSplat<Real> out;
    out.dimming = 1;
    for (int k = 0; k < 3; ++k) {
        const Real s = std::exp(log_scale[k]);
        out.scales[k] = std::hypot(s, filter);
        out.kept[k] = s / out.scales[k];
        out.dimming *= out.kept[k];
    }
    return out;
}

/// From derivatives by the logarithms of smoothed scales and by the smoothed opacity to those by
/// the logarithms of scales; the filter is a constant.
template <class Real>
TVSGS_HD Vec3<Real> smoothed_vjp(const SmoothedSplat<Real>& splat,
                                 Real smoothed_opacity,
                                 Vec3<Real> dL_dlog_scales,
                                 Real dL_dopacity) {
    Vec3<Real> g;
    for (int k = 0; k < 3; ++k) {
        const Real share = splat.kept[k] * splat.kept[k];
        g[k] = share * dL_dlog_scales[k] + (1 - share) * smoothed_opacity * dL_dopacity;
    }
    return g;
}

}  // namespace tvsgs
