// Blending model of ellipses with colours, normals and sloping distances.
#pragma once

#include "render/backbone.h"
#include "render/tiles/blend.h"
#include "render/tiles/blend_math.h"

namespace tvsgs {

/// Features with the distance at the mean and its slope. Padded to 16-byte words.
struct alignas(16) RadeRecord {
    SplatFeatures<float> f;
    Vec2f slope;  // world units per px, as in RadePlane
};

/// Sums of one splat over pixels. Padded to 16-byte words.
template <class Real>
struct alignas(16) RadeGradients {
    SplatGradients<Real> of;  // before complete(); features.distance: by the distance at the mean
    Vec2<Real> slope;
    Vec2<Real> unused;

    static constexpr int kCount = 20;
};

/// State of a pixel in the forward pass.
template <class Real>
struct RadePixel : PixelForward<Real> {
    Real median = 0;  // distance of the last splat that more than half of the light reaches
};

/// dL/d of a pixel's sums, and values that the backward pass needs.
template <class Real>
struct RadePixelGradient {
    SplatFeatures<Real> by{};  // by.distance: of the sum divided by the sum of weights
    Real mean = 0;             // that quotient
    Real median = 0;
};

/// State of a pixel in the backward pass.
template <class Real>
struct RadePixelBackward {
    Real T;  // behind the next splat to visit
    RadePixelGradient<Real> by;
    Real behind = 0;  // as in blend_math.h
    bool had_median = false;
};

/// Like the blend() that it calls. `d`: mean minus pixel centre.
template <class Real>
TVSGS_HD bool blend(
    RadePixel<Real>& pixel, Real alpha, Vec2<Real> d, SplatFeatures<Real> f, Vec2<Real> slope) {
    f.distance = alpha > 0 ? f.distance + dot(slope, d) : 0;  // d may be out of reach
    const bool in_front = alpha > 0 && pixel.T > Real(kFrontTransmittance);
    const bool fits = blend<Channels::color_plane>(pixel, alpha, f);
    if (fits && in_front) pixel.median = f.distance;
    return fits;
}

/// Like the blend_vjp() that it calls. The divisor of the mean, the sum of all weights, counts as
/// another feature that is 1 for each splat. So dL/dweight depends on the distance from the mean.
template <class Real>
TVSGS_HD void blend_vjp(RadePixelBackward<Real>& pixel,
                        const EllipseRoot<Real>& root,
                        Vec2<Real> d,
                        Vec2<Real> w,
                        SplatAlpha<Real> a,
                        SplatFeatures<Real> f,
                        Vec2<Real> slope,
                        RadeGradients<Real>& g) {
    f.distance = a.alpha > 0 ? f.distance + dot(slope, d) - pixel.by.mean : 0;
    PixelBackward<Real> front{pixel.T, pixel.by.by, pixel.behind};
    blend_vjp<Channels::color_plane>(front, root, f, w, a, g.of);
    pixel.T = front.T, pixel.behind = front.behind;
    if (!(a.alpha > 0)) return;
    const bool is_median = pixel.T > Real(kFrontTransmittance) && !pixel.had_median;
    pixel.had_median = pixel.had_median || is_median;
    const Real by_median = is_median ? pixel.by.median : 0;
    g.of.features.distance += by_median;
    g.slope += (a.alpha * pixel.T * pixel.by.by.distance + by_median) * d;
}

/// Blended distances of a pixel as depths along the axis: the mean by weight, and the median. 0 if
/// nothing is drawn, or if the slope of a splat leads behind the camera.
template <class Real>
struct RadeDepths {
    Real expected, median;
};
template <class Real>
TVSGS_HD RadeDepths<Real> rade_depths(const RadePixel<Real>& pixel, Real ray_length) {
    const Real coverage = 1 - pixel.T;
    if (!(coverage >= Real(1e-4))) return {0, 0};
    const Real mean = pixel.sum.distance / (coverage * ray_length),
               median = pixel.median / ray_length;
    return {mean > 0 ? mean : 0, median > 0 ? median : 0};
}

/// Blending model for colours only, or for all maps.
template <bool kMaps>
struct RadeModel {
    using Shape = SplatShape<float>;
    using Features = RadeRecord;
    using Gradients = RadeGradients<float>;
    using PixelForward = RadePixel<float>;
    using PixelGradient = RadePixelGradient<float>;
    using PixelBackward = RadePixelBackward<float>;

    struct Hit {
        float gauss, alpha;
        Vec2f offset, whitened;
    };

    struct Writer {
        Camera camera;
        Span<Vec3f> color, normal;
        Span<float> transmittance, depth, expected_depth, normal_length;
        bool median;  // depth is the median, else the mean

        TVSGS_HD void operator()(int x, int y, const PixelForward& pixel) const {
            const int at = y * camera.width_px + x;
            transmittance[at] = pixel.T;
            if (!color.empty()) color[at] = pixel.sum.color;
            if constexpr (kMaps) {
                const RadeDepths<float> depths = rade_depths(pixel, norm(pixel_ray(camera, x, y)));
                expected_depth[at] = depths.expected;
                depth[at] = median ? depths.median : depths.expected;
                normal_length[at] = norm(pixel.sum.normal);
                normal[at] = normalize(pixel.sum.normal);
            }
        }
    };

    /// Missing gradients are zero.
    struct Reader {
        Camera camera;
        Span<const Vec3f> dL_dcolor, dL_dnormal;
        Span<const float> dL_ddepth, dL_dexpected_depth;
        Span<const Vec3f> normal;
        Span<const float> transmittance, depth, expected_depth, normal_length;
        bool median;
        Span<const float> dL_dtransmittance{};

        TVSGS_HD PixelGradient operator()(int at) const {
            PixelGradient g;
            if (!dL_dcolor.empty()) g.by.color = dL_dcolor[at];
            if constexpr (kMaps) {
                if (!dL_dnormal.empty() && normal_length[at] > kLeastNormal) {
                    const Vec3f n = normal[at], by = dL_dnormal[at];
                    g.by.normal = (by - dot(by, n) * n) / normal_length[at];
                }
                const int x = at % camera.width_px, y = at / camera.width_px;
                const float ray = norm(pixel_ray(camera, x, y));
                const float by_depth = !dL_ddepth.empty() && depth[at] > 0 ? dL_ddepth[at] : 0;
                float by_mean = median ? 0 : by_depth;
                if (!dL_dexpected_depth.empty() && expected_depth[at] > 0)
                    by_mean += dL_dexpected_depth[at];
                g.mean = expected_depth[at] * ray;
                if (by_mean != 0) g.by.distance = by_mean / (ray * (1 - transmittance[at]));
                if (median) g.median = by_depth / ray;
            }
            return g;
        }
        TVSGS_HD float behind(int at) const {
            return dL_dtransmittance.empty() ? 0 : dL_dtransmittance[at];
        }
    };
    static constexpr float kLeastNormal = 1e-12f;  // as in normalize()

    TVSGS_HD static Vec2f offset(const Shape& s, Vec2f pixel) {
        return {s.mean.x - pixel.x, s.mean.y - pixel.y};
    }
    TVSGS_HD static Hit hit(const Shape& s, Vec2f d) {
        const SplatAlpha<float> a = splat_alpha(s, d);
        return {a.gauss, a.alpha, d, tvsgs::whitened(s.root, d)};
    }
    TVSGS_HD static bool blend(PixelForward& pixel, const Hit& hit, const Features& features) {
        if constexpr (kMaps)
            return tvsgs::blend(pixel, hit.alpha, hit.offset, features.f, features.slope);
        else
            return tvsgs::blend<Channels::color>(pixel, hit.alpha, features.f);
    }
    TVSGS_HD static void blend_vjp(PixelBackward& pixel,
                                   const Shape& s,
                                   const Features& features,
                                   const Hit& hit,
                                   Gradients& g) {
        const SplatAlpha<float> a{hit.gauss, hit.alpha};
        if constexpr (kMaps) {
            tvsgs::blend_vjp(pixel, s.root, hit.offset, hit.whitened, a, features.f, features.slope,
                             g);
        } else {
            tvsgs::PixelBackward<float> front{pixel.T, pixel.by.by, pixel.behind};
            tvsgs::blend_vjp<Channels::color>(front, s.root, features.f, hit.whitened, a, g.of);
            pixel.T = front.T, pixel.behind = front.behind;
        }
    }
    TVSGS_HD static void copy(const Features& from, Features& to) {
        if constexpr (kMaps)
            to = from;
        else
            to.f.color = from.f.color;
    }

    static constexpr int kColored = 11;  // values up to the colour
    static constexpr int kFilled = kMaps ? 18 : kColored + 1;
    TVSGS_HD static constexpr int filled(int v) {
        return kMaps || v < kColored ? v : SplatGradients<float>::kCount - 1;  // front_pixels
    }
};

}  // namespace tvsgs
