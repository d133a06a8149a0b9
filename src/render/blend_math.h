// Front-to-back compositing of one pixel, and its backward, one splat at a time; both devices walk
// their lists with these. [Kerbl23, Eq. 2-3], plane channels and unbiased depth: [PGSR]
#pragma once

#include "core/vec.h"
#include "render/backbone.h"

namespace tvsgs {

inline constexpr float kMinAlpha = 1.0f / 255;  // below one step of 8-bit colour
inline constexpr float kMaxAlpha =
    0.99f;  // keeps 1 - alpha, by which the backward divides, away from 0
inline constexpr float kMinTransmittance = 1e-4f;   // behind this nothing is visible
inline constexpr float kFrontTransmittance = 0.5f;  // "in front" for the observation count

/// The ellipse of a splat in the image.
template <class Real>
struct SplatShape {
    Vec2<Real> mean;    // px, corner convention
    Sym2<Real> conic;   // 1/px^2
    Real opacity;       // activated
    Vec2<Real> extent;  // half-widths of the box in which alpha can reach kMinAlpha, px
};

/// What a splat adds to the channels.
template <class Real>
struct SplatFeatures {
    Vec3<Real> color;
    Vec3<Real> normal;  // camera frame
    Real distance;      // world units
};

/// Sum over the channels that a set holds.
template <Channels kChannels, class Real>
TVSGS_HD Real feature_dot(const SplatFeatures<Real>& a, const SplatFeatures<Real>& b) {
    Real sum = 0;
    if constexpr (has_color(kChannels)) sum += dot(a.color, b.color);
    if constexpr (has_plane(kChannels)) sum += dot(a.normal, b.normal) + a.distance * b.distance;
    return sum;
}

/// target += weight * f, channels of the set only.
template <Channels kChannels, class Real>
TVSGS_HD void add_features(SplatFeatures<Real>& target, Real weight, const SplatFeatures<Real>& f) {
    if constexpr (has_color(kChannels)) target.color += weight * f.color;
    if constexpr (has_plane(kChannels)) {
        target.normal += weight * f.normal;
        target.distance += weight * f.distance;
    }
}

/// Gaussian value and clamped alpha at a pixel; alpha = 0 says that the splat is skipped there.
template <class Real>
struct SplatAlpha {
    Real gauss, alpha;
};

/// `d` = mean - pixel centre. Forward and backward must decide alike, so both call this.
template <class Real>
TVSGS_HD SplatAlpha<Real> splat_alpha(const SplatShape<Real>& s, Vec2<Real> d) {
    const Real power =
        Real(-0.5) * (s.conic.xx * d.x * d.x + s.conic.yy * d.y * d.y) - s.conic.xy * d.x * d.y;
    if (!(power <= 0)) return {0, 0};
    const Real gauss = std::exp(power);
    const Real alpha = s.opacity * gauss;
    if (!(alpha >= Real(kMinAlpha))) return {0, 0};
    return {gauss, alpha < Real(kMaxAlpha) ? alpha : Real(kMaxAlpha)};
}

/// One pixel's running state on the way to the back.
template <class Real>
struct PixelForward {
    Real T = 1;
    SplatFeatures<Real> sum{};
};

/// Blends one splat; false when the pixel is full and the splat was not blended.
template <Channels kChannels, class Real>
TVSGS_HD bool blend(PixelForward<Real>& pixel, Real alpha, const SplatFeatures<Real>& f) {
    const Real next = pixel.T * (1 - alpha);
    if (next < Real(kMinTransmittance)) return false;
    add_features<kChannels>(pixel.sum, alpha * pixel.T, f);
    pixel.T = next;
    return true;
}

/// One pixel's running state on the way back to the front.
template <class Real>
struct PixelBackward {
    Real T;  // behind the next splat to visit; starts at the final transmittance
    SplatFeatures<Real> dL_dpixel;  // gradient of the blended channels
    SplatFeatures<Real> behind{};   // blended features behind, as if seen with T = 1
};

/// Gradients of one splat; what a backward pass sums over pixels.
template <class Real>
struct SplatGradients {
    Vec2<Real> mean, abs_mean;  // per px; abs: sum of absolute values per pixel
    Sym2<Real> conic;  // xy holds the derivative of the packed entry (both off-diagonal places)
    Real opacity;
    SplatFeatures<Real> features;
    Real front_pixels;  // pixels where T in front of the splat exceeds one half

    static constexpr int kCount = 16;
};
static_assert(sizeof(SplatGradients<float>) == SplatGradients<float>::kCount * sizeof(float));

/// One splat at one pixel, visited back to front; `a` is splat_alpha's result with a.alpha > 0.
/// Adds to `g`. The upper clamp of alpha is passed straight through, as in the official code.
template <Channels kChannels, class Real>
TVSGS_HD void blend_vjp(PixelBackward<Real>& pixel,
                        const SplatShape<Real>& s,
                        const SplatFeatures<Real>& f,
                        Vec2<Real> d,
                        SplatAlpha<Real> a,
                        SplatGradients<Real>& g) {
    const Real T = pixel.T / (1 - a.alpha);  // in front of this splat
    const Real dL_dalpha = T * (feature_dot<kChannels>(f, pixel.dL_dpixel) -
                                feature_dot<kChannels>(pixel.behind, pixel.dL_dpixel));
    add_features<kChannels>(g.features, a.alpha * T, pixel.dL_dpixel);

    // behind <- alpha f + (1 - alpha) behind
    SplatFeatures<Real> behind{};
    add_features<kChannels>(behind, a.alpha, f);
    add_features<kChannels>(behind, 1 - a.alpha, pixel.behind);
    pixel.behind = behind;
    pixel.T = T;

    const Real dL_dgauss = s.opacity * dL_dalpha;
    g.opacity += a.gauss * dL_dalpha;
    const Real common = a.gauss * dL_dgauss;
    const Vec2<Real> dL_dmean = {-common * (s.conic.xx * d.x + s.conic.xy * d.y),
                                 -common * (s.conic.xy * d.x + s.conic.yy * d.y)};
    g.mean += dL_dmean;
    g.abs_mean += Vec2<Real>{std::abs(dL_dmean.x), std::abs(dL_dmean.y)};
    g.conic.xx -= Real(0.5) * common * d.x * d.x;
    g.conic.xy -= common * d.x * d.y;
    g.conic.yy -= Real(0.5) * common * d.y * d.y;
    if (T > Real(kFrontTransmittance)) g.front_pixels += 1;
}

/// Least value of the conic's quadratic form over the rectangle of pixel centres [low, high].
template <class Real>
TVSGS_HD Real least_quadratic(const SplatShape<Real>& s, Vec2<Real> low, Vec2<Real> high) {
    const auto clamped = [](Real value, Real lo, Real hi) {
        return value < lo ? lo : value > hi ? hi : value;
    };
    const Real nearest_x = clamped(s.mean.x, low.x, high.x),
               nearest_y = clamped(s.mean.y, low.y, high.y);
    const Real dx = nearest_x - s.mean.x, dy = nearest_y - s.mean.y;
    if (dx == 0 && dy == 0) return 0;
    const auto q = [&](Real x, Real y) {
        return s.conic.xx * x * x + 2 * s.conic.xy * x * y + s.conic.yy * y * y;
    };
    // The minimum lies on an edge that faces the mean.
    Real least = Real(3e38);
    if (dx != 0)
        least = q(dx, clamped(-s.conic.xy * dx / s.conic.yy, low.y - s.mean.y, high.y - s.mean.y));
    if (dy != 0) {
        const Real other =
            q(clamped(-s.conic.xy * dy / s.conic.xx, low.x - s.mean.x, high.x - s.mean.x), dy);
        least = other < least ? other : least;
    }
    return least;
}

/// The plane's depth along a pixel ray r (z = 1): D = distance / -(normal . r); 0 where it is
/// undefined. The blending weights' sum cancels. `coverage` = 1 - T; grazing rays and almost empty
/// pixels have no depth.
template <class Real>
TVSGS_HD Real plane_depth(Vec3<Real> normal, Real distance, Vec3<Real> ray, Real coverage) {
    const Real facing = -dot(normal, ray);
    if (!(coverage >= Real(1e-4)) || !(facing >= Real(1e-3) * coverage)) return 0;
    const Real depth = distance / facing;
    return depth > 0 ? depth : 0;
}

template <class Real>
struct PlaneDepthGradients {
    Vec3<Real> dL_dnormal;
    Real dL_ddistance;
};

/// Only where plane_depth is not 0.
template <class Real>
TVSGS_HD PlaneDepthGradients<Real> plane_depth_vjp(Vec3<Real> normal,
                                                   Real distance,
                                                   Vec3<Real> ray,
                                                   Real dL_ddepth) {
    const Real facing = -dot(normal, ray);
    return {dL_ddepth * distance / (facing * facing) * ray, dL_ddepth / facing};
}

}  // namespace tvsgs
