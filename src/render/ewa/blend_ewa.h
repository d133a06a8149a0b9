// Blending model of ellipses with colours and PGSR's planes.
#pragma once

#include "render/backbone.h"
#include "render/tiles/blend.h"
#include "render/tiles/blend_math.h"

namespace tvsgs {

/// Padded to 16-byte words.
struct alignas(16) FeatureRecord {
    SplatFeatures<float> f;
    float color_share;  // as in blend_vjp()
};

template <class Device>
using EwaSplats = ViewSplats<Device, SplatShape<float>, FeatureRecord>;
template <class Device>
using EwaFragmentGradients = FragmentGradients<Device, SplatGradients<float>>;

/// Writes the images of the channel set with a black background. Writes depth only with plane
/// channels, along the rays of images.camera.
template <Channels kChannels>
struct PixelWriter {
    Span<Vec3f> color, normal;
    Span<float> transmittance, distance, depth;
    Camera camera;

    template <class Device>
    PixelWriter(RenderedImages<Device>& images, Buffer<float, Device>& distances)
        : color(images.color.span()),
          normal(images.normal.span()),
          transmittance(images.transmittance.span()),
          distance(distances.span()),
          depth(images.depth.span()),
          camera(images.camera) {}

    TVSGS_HD void operator()(int x, int y, const PixelForward<float>& pixel) const {
        const int at = y * camera.width_px + x;
        transmittance[at] = pixel.T;
        if constexpr (has_color(kChannels)) color[at] = pixel.sum.color;
        if constexpr (has_plane(kChannels)) {
            normal[at] = pixel.sum.normal;
            distance[at] = pixel.sum.distance;
            depth[at] = plane_depth(pixel.sum.normal, pixel.sum.distance, pixel_ray(camera, x, y),
                                    1 - pixel.T);
        }
    }
};

/// Reads the gradients of a pixel's channels. Missing gradients are zero.
template <Channels kChannels>
struct PixelGradientReader {
    Span<const Vec3f> color, normal;
    Span<const float> distance, transmittance{};

    TVSGS_HD SplatFeatures<float> operator()(int at) const {
        SplatFeatures<float> g{};
        if constexpr (has_color(kChannels)) {
            if (!color.empty()) g.color = color[at];
        }
        if constexpr (has_plane(kChannels)) {
            if (!normal.empty()) g.normal = normal[at];
            if (!distance.empty()) g.distance = distance[at];
        }
        return g;
    }
    TVSGS_HD float behind(int at) const { return transmittance.empty() ? 0 : transmittance[at]; }
};

// Defined in blend_ewa_packs.h. The declaration makes a .cpp file that forgets that header fail to
// compile; otherwise it would blend pixel by pixel.
template <>
struct TileFinder<SplatShape<float>>;
template <Channels kChannels>
struct EwaForwardPacks;
template <Channels kChannels, bool kParted>
struct EwaBackwardPacks;

/// Blending model of one channel set; see blend.h. `kParted`: as in blend_vjp().
template <Channels kChannels, bool kParted = false>
struct EwaModel {
    using Shape = SplatShape<float>;
    using Features = FeatureRecord;
    using Gradients = SplatGradients<float>;  // before complete()
    using PixelForward = tvsgs::PixelForward<float>;
    using PixelGradient = SplatFeatures<float>;
    using PixelBackward = tvsgs::PixelBackward<float>;
    using Writer = PixelWriter<kChannels>;
    using Reader = PixelGradientReader<kChannels>;
    using ForwardPacks = EwaForwardPacks<kChannels>;
    using BackwardPacks = EwaBackwardPacks<kChannels, kParted>;

    struct Hit {
        float gauss, alpha;
        Vec2f whitened;
    };

    /// Vector from a pixel centre to the mean.
    TVSGS_HD static Vec2f offset(const Shape& s, Vec2f pixel) {
        return {s.mean.x - pixel.x, s.mean.y - pixel.y};
    }
    TVSGS_HD static Hit hit(const Shape& s, Vec2f d) {
        const SplatAlpha<float> a = splat_alpha(s, d);
        return {a.gauss, a.alpha, whitened(s.root, d)};
    }
    TVSGS_HD static bool blend(PixelForward& pixel, const Hit& hit, const Features& features) {
        return tvsgs::blend<kChannels>(pixel, hit.alpha, features.f);
    }
    TVSGS_HD static void blend_vjp(PixelBackward& pixel,
                                   const Shape& s,
                                   const Features& features,
                                   const Hit& hit,
                                   Gradients& g) {
        tvsgs::blend_vjp<kChannels, kParted>(pixel, s.root, features.f, hit.whitened,
                                             SplatAlpha<float>{hit.gauss, hit.alpha}, g,
                                             features.color_share);
    }

    TVSGS_HD static void copy(const Features& from, Features& to) {
        if constexpr (has_color(kChannels) && has_plane(kChannels))
            to = from;
        else if constexpr (has_color(kChannels))
            to.f.color = from.f.color;
        else
            to.f.normal = from.f.normal, to.f.distance = from.f.distance;
        if constexpr (kParted) to.color_share = from.color_share;
    }

    static constexpr int kCommon = 8;  // gradients up to the opacity's, before the features'
    static constexpr int kFilled =
        kCommon + (has_color(kChannels) ? 3 : 0) + (has_plane(kChannels) ? 4 : 0) + 1;
    TVSGS_HD static constexpr int filled(int v) {
        if (v == kFilled - 1) return Gradients::kCount - 1;
        return v < kCommon || has_color(kChannels) ? v : v + 3;
    }
};

template <Channels kChannels>
using PartedEwaModel = EwaModel<kChannels, true>;

}  // namespace tvsgs
