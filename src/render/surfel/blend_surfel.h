// Blending model of surfels.
#pragma once

#include "render/backbone.h"
#include "render/surfel/surfel_math.h"
#include "render/tiles/blend.h"

namespace tvsgs {

/// Padded to 16-byte words.
struct alignas(16) SurfelRecord {
    SurfelFeatures<float> f;
    float color_share;  // as in blend_vjp()
};

template <class Device>
using Surfels = ViewSplats<Device, SurfelShape<float>, SurfelRecord>;

/// Surface depth from the blended depths: the mean by weight, or the median. 0 (undefined) if
/// nothing is drawn.
template <class Real>
TVSGS_HD Real surfel_depth(const SurfelPixel<Real>& pixel, bool median) {
    const Real coverage = 1 - pixel.T;
    if (!(coverage >= Real(1e-4))) return 0;
    return median ? pixel.median : pixel.z / coverage;
}

/// Blending model for colours only, or for all maps. `kParted`: as in blend_vjp().
template <bool kMaps, bool kParted = false>
struct SurfelModel {
    using Shape = SurfelShape<float>;
    using Features = SurfelRecord;
    using Gradients = SurfelGradients<kMaps, float>;  // before surfel_inverse_vjp()
    using Hit = SurfelHit<float>;
    using PixelForward = SurfelPixel<float>;
    using PixelGradient = SurfelPixelGradient<float>;
    using PixelBackward = SurfelPixelBackward<float>;

    struct Writer {
        Span<Vec3f> color, normal;
        Span<float> transmittance, depth, distortion, z, first, second;
        int width;
        bool median;

        TVSGS_HD void operator()(int x, int y, const PixelForward& pixel) const {
            const int at = y * width + x;
            transmittance[at] = pixel.T;
            if (!color.empty()) color[at] = pixel.color;
            if constexpr (kMaps) {
                normal[at] = pixel.normal;
                depth[at] = surfel_depth(pixel, median);
                distortion[at] = pixel.distortion;
                z[at] = pixel.z, first[at] = pixel.first, second[at] = pixel.second;
            }
        }
    };

    /// Missing gradients are zero.
    struct Reader {
        Span<const Vec3f> dL_dcolor, dL_dnormal;
        Span<const float> dL_ddepth, dL_ddistortion;
        Span<const float> transmittance, depth, z, first, second;
        bool median;
        Span<const float> dL_dtransmittance{};

        TVSGS_HD PixelGradient operator()(int at) const {
            PixelGradient g;
            if (!dL_dcolor.empty()) g.color = dL_dcolor[at];
            if constexpr (kMaps) {
                if (!dL_dnormal.empty()) g.normal = dL_dnormal[at];
                if (!dL_ddepth.empty() && depth[at] > 0) {
                    if (median) {
                        g.median = dL_ddepth[at];
                    } else {
                        g.z = dL_ddepth[at] / (1 - transmittance[at]);
                        g.coverage = -g.z * depth[at];
                    }
                }
                if (!dL_ddistortion.empty()) g.distortion = dL_ddistortion[at];
                g.all = 1 - transmittance[at], g.first = first[at], g.second = second[at];
            }
            return g;
        }
        TVSGS_HD float behind(int at) const {
            return dL_dtransmittance.empty() ? 0 : dL_dtransmittance[at];
        }
    };

    /// Vector from the mean to a pixel centre.
    TVSGS_HD static Vec2f offset(const Shape& s, Vec2f pixel) { return pixel - s.mean; }
    TVSGS_HD static Hit hit(const Shape& s, Vec2f d) { return surfel_hit(s, d); }
    TVSGS_HD static bool blend(PixelForward& pixel, const Hit& hit, const Features& features) {
        return tvsgs::blend<kMaps>(pixel, hit, features.f);
    }
    TVSGS_HD static void blend_vjp(PixelBackward& pixel,
                                   const Shape& s,
                                   const Features& features,
                                   const Hit& hit,
                                   Gradients& g) {
        tvsgs::blend_vjp<kMaps, kParted>(pixel, s, features.f, hit, g, features.color_share);
    }
    TVSGS_HD static void copy(const Features& from, Features& to) {
        to.f.color = from.f.color;
        if constexpr (kMaps) to.f.normal = from.f.normal;
        if constexpr (kParted) to.color_share = from.color_share;
    }

    static constexpr int kFilled = Gradients::kCount;
    TVSGS_HD static constexpr int filled(int v) { return v; }
};

template <bool kMaps>
using PartedSurfelModel = SurfelModel<kMaps, true>;

}  // namespace tvsgs
