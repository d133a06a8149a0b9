// 3D smoothing filter: limits splats to the finest detail that the photographs can show.  [Yu24]
#pragma once

#include "core/math/vec.h"

namespace tvsgs {

/// A splat convolved with an isotropic Gaussian. Its peak drops as its volume grows.
template <class Real>
struct SmoothedSplat {
    Vec3<Real> scales;  // standard deviations, world units
    Vec3<Real> kept;    // scales before / after the filter, at most 1
    Real dimming;       // factor on the opacity: product of `kept`
};

/// `filter`: standard deviation of the Gaussian, world units; 0 changes nothing. The factor is a
/// product over the axes: the square root of a quotient of products of squares would underflow for
/// flat splats.
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

/// Derivatives by the logarithms of the scales, from the derivatives by the logarithms of the
/// smoothed scales and by the smoothed opacity. The filter is a constant.
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
