// Depth along rays: mean or median of the splats that a pixel blends. Each is a separate pass over
// the lists that blending used.
#pragma once

#include "render/depth/median_math.h"
#include "render/rade/ray_profile_math.h"
#include "render/tiles/blend.h"
#include "render/tiles/blend_math.h"
#include "render/tiles/splat_places.h"

namespace tvsgs {

/// Computes the profiles of the splats in view. A separate pass, so that renders without depth
/// along rays skip it.
struct RayProfileBody {
    Pinhole<float> camera;
    Span<const Vec3f> means, log_scales;
    Span<const Quatf> quats;
    SplatPlaces places;
    float shift;  // of rays, see RayProfile
    Span<RayProfile<float>> profiles;

    TVSGS_HD void operator()(int i) const {
        if (const std::uint32_t at = places.of(i); at < profiles.count)
            profiles[at] = ray_profile(camera, rotation(normalize(quats[i])), exp(log_scales[i]),
                                       camera.camera_from_world * means[i], shift);
    }
};

/// Gradients of a splat by a depth along rays, summed over pixels; those of alpha as in
/// SplatGradients. Padded to 16-byte words.
struct alignas(16) RayDepthGradients {
    Vec2f mean;
    Sym2f spread;
    float opacity;
    RayProfileGradients<float> profile;
    float unused;

    static constexpr int kCount = 16;
};
template <class Device>
using RayDepthFragments = FragmentGradients<Device, RayDepthGradients>;

/// Common part of both depth models. A splat counts where blending drew it.
struct RayDepthModel {
    using Shape = SplatShape<float>;
    using Features = RayProfile<float>;
    using Gradients = RayDepthGradients;

    struct Hit {
        float gauss, alpha;
        Vec2f whitened, offset;  // offset: from the mean to the pixel; 0 if alpha is 0
    };

    TVSGS_HD static Vec2f offset(const Shape& s, Vec2f pixel) {
        return {s.mean.x - pixel.x, s.mean.y - pixel.y};
    }
    TVSGS_HD static Hit hit(const Shape& s, Vec2f d) {
        const SplatAlpha<float> a = splat_alpha(s, d);
        const bool draws = a.alpha > 0;
        const Vec2f inside{draws ? d.x : 0.0f, draws ? d.y : 0.0f};
        return {a.gauss, a.alpha, whitened(s.root, inside), {-inside.x, -inside.y}};
    }
    TVSGS_HD static void copy(const Features& from, Features& to) { to = from; }

    static constexpr int kFilled = Gradients::kCount - 1;
    TVSGS_HD static constexpr int filled(int v) { return v; }
};

/// Mean depth: sum w t / sum w over the blended splats; 0 if the sum of weights is almost 0.
struct MeanDepthModel : RayDepthModel {
    struct PixelForward {
        float T = 1, sum = 0;
    };
    struct PixelGradient {
        float sum = 0, weight = 0;  // by the two sums
    };
    struct PixelBackward {
        float T;
        PixelGradient by;
        float behind = 0;
    };

    struct Writer {
        Span<float> depth;
        int width;

        TVSGS_HD void operator()(int x, int y, const PixelForward& pixel) const {
            const float weight = 1 - pixel.T;
            const float mean = weight >= 1e-4f ? pixel.sum / weight : 0;
            depth[y * width + x] = mean > 0 ? mean : 0;
        }
    };
    struct Reader {
        Span<const float> depth, transmittance, dL_ddepth;

        TVSGS_HD PixelGradient operator()(int at) const {
            if (!(depth[at] > 0)) return {};
            const float by_sum = dL_ddepth[at] / (1 - transmittance[at]);
            return {by_sum, -by_sum * depth[at]};
        }
    };

    TVSGS_HD static bool blend(PixelForward& pixel, const Hit& hit, const Features& profile) {
        const float next = pixel.T * (1 - hit.alpha);
        const bool fits = !(next < kMinTransmittance);
        pixel.sum += (fits ? hit.alpha * pixel.T : 0.0f) * ray_point(profile, hit.offset).depth;
        pixel.T = fits ? next : pixel.T;
        return fits;
    }
    TVSGS_HD static void blend_vjp(
        PixelBackward& pixel, const Shape&, const Features& profile, const Hit& hit, Gradients& g) {
        const RayPoint<float> point = ray_point(profile, hit.offset);
        const float T = pixel.T * FastMath::inverse(1 - hit.alpha);
        const float step = point.depth * pixel.by.sum + pixel.by.weight - pixel.behind;
        pixel.behind += hit.alpha * step;
        pixel.T = T;
        add_alpha_gradient(hit.gauss * (T * step), hit.whitened, g);
        ray_point_vjp(profile, hit.offset, point, hit.alpha * T * pixel.by.sum, 0.0f, g.profile);
    }
};

/// Backward pass of the median depth; find_medians() is its forward pass. It uses the stops of
/// MedianView.
struct MedianDepthModel : RayDepthModel {
    struct PixelGradient {
        float light = 0, depth = 0;  // dL/d(ln T at the median); the median
    };
    struct PixelBackward {
        float T;  // not used here
        PixelGradient by;
    };

    struct Reader {
        Span<const float> depth, slope, dL_ddepth;

        TVSGS_HD PixelGradient operator()(int at) const {
            return {median_vjp(depth[at], slope[at], dL_ddepth[at]), depth[at]};
        }
    };

    TVSGS_HD static void blend_vjp(
        PixelBackward& pixel, const Shape&, const Features& profile, const Hit& hit, Gradients& g) {
        const RayPoint<float> point = ray_point(profile, hit.offset);
        const float x = (pixel.by.depth - point.depth) * point.inverse, light = pixel.by.light;
        const auto by = log_transmittance_vjp(hit.alpha, x, point.deviation, point.inverse);
        add_alpha_gradient(hit.gauss * (light * by.by_alpha), hit.whitened, g);
        ray_point_vjp(profile, hit.offset, point, -light * by.by_depth, light * by.by_square,
                      g.profile);
    }
};

/// Arguments and results of find_medians(), all [H W]. kDepthTransmittance defines the splats that
/// count.
struct MedianView {
    Span<const SplatShape<float>> shapes;
    Span<const RayProfile<float>> profiles;
    Span<const TileSpan> spans;
    Span<const std::uint32_t> splats;
    TileGrid grid;
    Span<const float> transmittance;
    Span<const std::uint32_t> stops;
    // Overwritten; 0 if there is no median.
    Span<float> depth, slope;          // slope: of ln T, per unit of depth
    Span<std::uint32_t> median_stops;  // position after the last splat that counts
};

/// A splat that counts for a pixel's depth.
struct Crossing {
    float alpha, depth, inverse;  // as in RayPoint
};

/// Finds the median depths of a view. `crossings`: scratch, resized as needed.
void find_medians(Cpu, const MedianView& view, Buffer<Crossing, Cpu>& crossings);
void find_medians(Cuda, const MedianView& view, Buffer<Crossing, Cuda>& crossings);

/// Computes T^2 at the points of a search. crossing(i) returns splat i.
template <class CrossingAt>
TVSGS_HD void squared_transmittances(int count,
                                     const CrossingAt& crossing,
                                     const float (&points)[MedianSearch<float>::kPoints],
                                     float (&squares)[MedianSearch<float>::kPoints]) {
    for (float& square : squares) square = 1;
    for (int i = 0; i < count; ++i) {
        const Crossing c = crossing(i);
        for (int k = 0; k < MedianSearch<float>::kPoints; ++k)
            squares[k] *= squared_transmittance(c.alpha, (points[k] - c.depth) * c.inverse);
    }
}

}  // namespace tvsgs
