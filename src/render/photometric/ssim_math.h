// SSIM of one pixel from windowed moments of two images x and y.  [Wang04]; window and constants as
// in 3DGS
#pragma once

#include "core/device/device.h"

namespace tvsgs {

inline constexpr int kSsimRadius = 5;  // 11 taps, sigma 1.5, zero padding

/// Weight of the tap at distance |offset| <= kSsimRadius. The eleven weights sum to 1.
template <class Real>
TVSGS_HD constexpr Real ssim_weight(int offset) {
    constexpr double w[kSsimRadius + 1] = {0.26601172486179436,  0.2130055377112537,
                                           0.10936068950970002,  0.03600077212843083,
                                           0.007598758135239185, 0.0010283800844792066};
    return Real(w[offset < 0 ? -offset : offset]);
}

/// Windowed means of x, y, x^2, y^2 and x y.
template <class Real>
struct SsimMoments {
    Real x{}, y{}, xx{}, yy{}, xy{};
};

template <class Real>
struct SsimTerms {
    Real ssim, dS_dx, dS_dxx, dS_dxy;  // derivatives by the moments that contain x
};

template <class Real>
TVSGS_HD SsimTerms<Real> ssim_terms(const SsimMoments<Real>& m) {
    const Real c1 = Real(0.01 * 0.01), c2 = Real(0.03 * 0.03);
    const Real a1 = 2 * m.x * m.y + c1, a2 = 2 * (m.xy - m.x * m.y) + c2;
    const Real b1 = m.x * m.x + m.y * m.y + c1, b2 = (m.xx - m.x * m.x) + (m.yy - m.y * m.y) + c2;
    const Real inv = 1 / (b1 * b2), ssim = a1 * a2 * inv;
    return {ssim, 2 * m.y * (a2 - a1) * inv - 2 * m.x * ssim * (1 / b1 - 1 / b2), -ssim / b2,
            2 * a1 * inv};
}

}  // namespace tvsgs
