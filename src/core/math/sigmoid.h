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

}  // namespace tvsgs
