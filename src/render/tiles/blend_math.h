// Front-to-back blending of one splat at one pixel, and its derivative, for both devices. [Kerbl23,
// Eq. 2-3]; plane channels and unbiased depth: [PGSR]
#pragma once

#include <limits>

#include "core/math/fast_math.h"
#include "core/math/sigmoid.h"
#include "render/backbone.h"
#include "render/ewa/projection_math.h"

namespace tvsgs {

/// Channel sets of splats: colour, and all maps of their surface. Kernels are compiled per set, so
/// that unused maps cost nothing.
enum class Channels { color, color_plane, plane };

constexpr bool has_color(Channels channels) {
    return channels != Channels::plane;
}
constexpr bool has_plane(Channels channels) {
    return channels != Channels::color;
}

/// The smallest set that renders the maps. `plane`: maps that need more than colour.
constexpr Channels channels_of(Maps maps, Maps plane = kGeometryMaps) {
    return !has(maps, plane)        ? Channels::color
           : has(maps, Maps::color) ? Channels::color_plane
                                    : Channels::plane;
}

/// Calls run() as a template of the channels.
template <class Run>
void with_channels(Channels channels, const Run& run) {
    if (channels == Channels::color) return run.template operator()<Channels::color>();
    if (channels == Channels::plane) return run.template operator()<Channels::plane>();
    run.template operator()<Channels::color_plane>();
}

inline constexpr float kMinAlpha = 1.0f / 255;  // below one step of 8-bit colour
inline constexpr float kMaxAlpha =
    0.99f;  // keeps 1 - alpha, the divisor in the backward pass, away from 0
inline constexpr float kMinTransmittance = 1e-4f;   // nothing is visible behind this
inline constexpr float kFrontTransmittance = 0.5f;  // limit of "in front" for the observation count

/// The ellipse of a splat in the image. Padded to 16-byte words.
template <class Real>
struct alignas(16) SplatShape {
    Vec2<Real> mean;         // px; (0, 0) is the image corner
    EllipseRoot<Real> root;  // 1/px
    Real opacity;            // activated
    Real reach;              // splat_reach(): largest exponent with alpha >= kMinAlpha
};

/// Largest exponent at which alpha is at least kMinAlpha.
template <class Real>
TVSGS_HD Real splat_reach(Real opacity) {
    return std::log(opacity / Real(kMinAlpha));
}

/// Half-widths, px, of the box outside which alpha is below kMinAlpha.
template <class Real>
TVSGS_HD Vec2<Real> splat_extent(const SplatShape<Real>& s) {
    const EllipseRoot<Real>& R = s.root;
    return {std::sqrt(s.reach * (R.xy * R.xy + R.yy * R.yy)) / (R.xx * R.yy),
            std::sqrt(s.reach) / R.yy};
}

template <class Real>
struct SplatFeatures {
    Vec3<Real> color;
    Vec3<Real> normal;  // camera frame
    Real distance;      // world units
};

/// Dot product over the channels of the set.
template <Channels kChannels, class Real>
TVSGS_HD Real feature_dot(const SplatFeatures<Real>& a, const SplatFeatures<Real>& b) {
    if constexpr (!has_plane(kChannels)) return dot(a.color, b.color);
    Real sum = dot(a.normal, b.normal) + a.distance * b.distance;
    if constexpr (has_color(kChannels)) sum += dot(a.color, b.color);
    return sum;
}

/// target += weight * f, for the channels of the set.
template <Channels kChannels, class Real>
TVSGS_HD void add_features(SplatFeatures<Real>& target, Real weight, const SplatFeatures<Real>& f) {
    if constexpr (has_color(kChannels)) target.color += weight * f.color;
    if constexpr (has_plane(kChannels)) {
        target.normal += weight * f.normal;
        target.distance += weight * f.distance;
    }
}

/// Gaussian value and clamped alpha at a pixel. alpha = 0: the splat is skipped there.
template <class Real>
struct SplatAlpha {
    Real gauss, alpha;
};

/// `d` = mean - pixel centre. Forward and backward call this function, so that they decide alike.
/// FastMath: unless alpha is cut off, its exponential is accurate to 5 units in the last place.
template <class Real>
TVSGS_HD SplatAlpha<Real> splat_alpha(const SplatShape<Real>& s, Vec2<Real> d) {
    const Vec2<Real> w = whitened(s.root, d);
    const Real gauss = FastMath::decay(multiply_add(w.x, w.x, w.y * w.y));
    const Real alpha = s.opacity * gauss;
    if (!(alpha >= Real(kMinAlpha))) return {0, 0};
    return {gauss, alpha < Real(kMaxAlpha) ? alpha : Real(kMaxAlpha)};
}

template <class Real>
struct PixelForward {
    Real T = 1;
    SplatFeatures<Real> sum{};
};

/// Blends one splat. Returns false if the pixel is full and the splat was not blended.
template <Channels kChannels, class Real>
TVSGS_HD bool blend(PixelForward<Real>& pixel, Real alpha, const SplatFeatures<Real>& f) {
    const Real next = pixel.T * (1 - alpha);
    const bool fits = !(next < Real(kMinTransmittance));  // no branch: neighbouring pixels differ
    add_features<kChannels>(pixel.sum, fits ? alpha * pixel.T : Real(0), f);
    pixel.T = fits ? next : pixel.T;
    return fits;
}

template <class Real>
struct PixelBackward {
    Real T;  // behind the next splat to visit; starts at the final transmittance
    SplatFeatures<Real> dL_dpixel;  // gradient of the blended channels
    Real behind = 0;                // <dL_dpixel, blended features behind, as if seen with T = 1>
    Real plane_behind = 0;  // where colours are parted: `behind` is of colours, this of the plane
};

/// Gradients of one splat, summed over pixels. Padded to 16-byte words.
template <class Real>
struct alignas(16) SplatGradients {
    Vec2<Real> mean, abs_mean;  // per px; abs: sum of absolute values per pixel
    Sym2<Real> spread;          // -dL/dexponent w w^T, w = whitened(root, d)
    Real opacity;
    SplatFeatures<Real> features;
    Real front_pixels;  // pixels where T in front of the splat exceeds one half

    static constexpr int kCount = 16;
};

/// Counts a pixel at which the splat drew with more than half of the light.
template <class Real>
TVSGS_HD void count_front(Real& pixels, Real T, Real alpha) {
    pixels += T > Real(kFrontTransmittance) && alpha > 0 ? Real(1) : Real(0);
}

/// Adds one splat at one pixel, back to front, to `g`, without the splat's constant factors. w =
/// whitened(root, mean - pixel centre). An `a` of zeros adds nothing. The gradient passes the upper
/// clamp of alpha unchanged, as in the official code. With `kParted` only `color_share` of the
/// derivatives by colour and by the transmittance behind all splats reaches mean and spread;
/// opacity and colour get all of them.
template <Channels kChannels, bool kParted = false, class Real>
TVSGS_HD void blend_vjp(PixelBackward<Real>& pixel,
                        const EllipseRoot<Real>& root,
                        const SplatFeatures<Real>& f,
                        Vec2<Real> w,
                        SplatAlpha<Real> a,
                        SplatGradients<Real>& g,
                        Real color_share = Real(1)) {
    using std::abs;
    const Real T = pixel.T * FastMath::inverse(1 - a.alpha);  // in front of this splat
    add_features<kChannels>(g.features, a.alpha * T, pixel.dL_dpixel);
    // Features behind <- alpha f + (1 - alpha) features behind.
    Real step;
    if constexpr (kParted) {
        const Real color_step = feature_dot<Channels::color>(f, pixel.dL_dpixel) - pixel.behind;
        pixel.behind += a.alpha * color_step;
        Real plane_step(0);
        if constexpr (has_plane(kChannels)) {
            plane_step = feature_dot<Channels::plane>(f, pixel.dL_dpixel) - pixel.plane_behind;
            pixel.plane_behind += a.alpha * plane_step;
        }
        // The shape's step follows below.
        step = color_share * color_step + plane_step;
        g.opacity += a.gauss * (T * (color_step - color_share * color_step));
    } else {
        step = feature_dot<kChannels>(f, pixel.dL_dpixel) - pixel.behind;
        pixel.behind += a.alpha * step;
    }
    pixel.T = T;

    const Real change = a.gauss * (T * step);
    const Real x = change * w.x, y = change * w.y;
    g.abs_mean.x += abs(x), g.abs_mean.y += abs(root.xy * x + root.yy * y);
    g.opacity += change;
    g.mean.x += x, g.mean.y += y;
    g.spread.xx += x * w.x, g.spread.xy += x * w.y, g.spread.yy += y * w.y;
    count_front(g.front_pixels, T, a.alpha);
}

/// Multiplies the sums by the factors that blend_vjp() leaves out.
template <class Real>
TVSGS_HD void complete(SplatGradients<Real>& g, const SplatShape<Real>& s) {
    const EllipseRoot<Real>& R = s.root;
    g.mean = {-2 * s.opacity * (R.xx * g.mean.x),
              -2 * s.opacity * (R.xy * g.mean.x + R.yy * g.mean.y)};
    g.abs_mean = {2 * s.opacity * (R.xx * g.abs_mean.x), 2 * s.opacity * g.abs_mean.y};
    g.spread.xx *= s.opacity, g.spread.xy *= s.opacity, g.spread.yy *= s.opacity;
}

/// Lower bound of the exponent over the rectangle of pixel centres [low, high], as tight as
/// rounding allows: splat_alpha() computes no smaller exponent at any of them. The compiler cannot
/// fuse operations here, so all kernels get the same bits. A Real may be a Pack.
template <class Real>
TVSGS_HD Real least_exponent(const SplatShape<Real>& s, Vec2<Real> low, Vec2<Real> high) {
    using std::abs;
    const auto clamped = [](Real value, Real lo, Real hi) {
        return select(value < lo, lo, select(value > hi, hi, value));
    };
    const EllipseRoot<Real>& R = s.root;
    const Real zero(0);
    const Vec2<Real> from = low - s.mean, to = high - s.mean;
    const Real dx = clamped(zero, from.x, to.x), dy = clamped(zero, from.y, to.y);
    if (all(both(dx == zero, dy == zero))) return zero;
    const auto at = [&](Real x, Real y) {
        // Two evaluations of w.x, here and in splat_alpha(), differ by less than kError * size.
        constexpr double kError = 4 * (kIsDouble<Real> ? std::numeric_limits<double>::epsilon()
                                                       : std::numeric_limits<float>::epsilon());
        const Real size = multiply_add(abs(R.xy), abs(y), R.xx * abs(x));
        const Vec2<Real> w = whitened(R, {x, y});
        const Real surely = multiply_add(Real(-kError), size, abs(w.x));
        const Real u = select(surely > zero, surely, zero);
        return multiply_add(u, u, w.y * w.y);
    };
    // The minimum lies on an edge that faces the mean.
    const Real beside = choose(
        !(dx == zero),
        [&] {
            const Real yy = multiply_add(R.xy, R.xy, R.yy * R.yy);
            return at(dx, clamped(-(R.xx * R.xy) * dx * FastMath::inverse(yy), from.y, to.y));
        },
        Real(3e38));
    const Real above = choose(
        !(dy == zero),
        [&] { return at(clamped(-R.xy * dy * FastMath::inverse(R.xx), from.x, to.x), dy); },
        Real(3e38));
    const Real least = select(above < beside, above, beside);
    return select(both(dx == zero, dy == zero), zero, least);
}

/// True if the exponent can be within the splat's reach at a pixel centre in [low, high]. Rounding
/// errors can only cause false positives.
template <class Real>
TVSGS_HD auto may_draw(const SplatShape<Real>& s, Vec2<Real> low, Vec2<Real> high) {
    return least_exponent(s, low, high) <= s.reach + Real(1e-4);
}

/// Depth of the plane along a pixel ray r (z = 1): D = distance / -(normal . r); 0 if undefined.
/// The sum of blending weights cancels. `coverage` = 1 - T. Grazing rays and almost empty pixels
/// have no depth.
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

/// Call it only if plane_depth() is not 0.
template <class Real>
TVSGS_HD PlaneDepthGradients<Real> plane_depth_vjp(Vec3<Real> normal,
                                                   Real distance,
                                                   Vec3<Real> ray,
                                                   Real dL_ddepth) {
    const Real facing = -dot(normal, ray);
    return {dL_ddepth * distance / (facing * facing) * ray, dL_ddepth / facing};
}

}  // namespace tvsgs
