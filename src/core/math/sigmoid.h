// Opacity from its logit, and the derivative.
#pragma once

#include <cmath>

#include "core/device/device.h"

namespace tvsgs {

template <class Real>
TVSGS_HD Real sigmoid(Real logit) {
    return 1 / (1 + std::exp(-logit));
}
/// Derivative o (1 - o) of the sigmoid o without the difference 1 - o. This difference rounds to 0
/// where o is next to 1; an opaque splat would then get no gradient and stay opaque for ever.
template <class Real>
TVSGS_HD Real sigmoid_slope(Real logit) {
    const Real e = std::exp(-std::abs(logit));
    return e / ((1 + e) * (1 + e));
}
/// Logit of a splat's opacity with `share` (0, 1] of its optical depth: 1 - (1 - opacity)^share.
/// Two splats in one place whose shares sum to 1 transmit as much light as the original.
inline double faded_logit(double logit, double share) {
    // -log(1 - opacity), the optical depth; log(exp(x) - 1) = x where exp(x) overflows.
    const double depth = share * (logit > 30 ? logit : std::log1p(std::exp(logit)));
    return depth > 30 ? depth : std::log(std::expm1(depth));
}

}  // namespace tvsgs
