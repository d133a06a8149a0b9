// Splats of one view of the backbone `rade`, for both devices: projection to the image, and
// gradients of the parameters from their sums over pixels.  [RaDe-GS], filter: [Yu24]
#pragma once

#include "core/math/smoothing_filter.h"
#include "render/rade/blend_rade.h"
#include "render/rade/rade_math.h"
#include "render/tiles/splat_vjp.h"
#include "render/tiles/view_splats.h"

namespace tvsgs {

/// Splat i under its smoothing filter. An empty `filter` changes nothing.
TVSGS_HD inline SmoothedSplat<float> smoothed_at(Span<const float> filter, int i, Vec3f log_scale) {
    return smoothed(log_scale, filter.empty() ? 0.0f : filter[i]);
}

/// The official code draws nothing below this determinant in the image, px^4.
inline constexpr float kLeastRadeDet = 1e-6f;

/// Projection of splats; see splat_places.h.
struct ProjectRadeBody : SplatParameters {
    ViewParameters view;
    ViewRecords<SplatShape<float>, RadeRecord> to;
    Span<const float> filter;  // may be empty
    bool maps;

    struct Found {
        Vec3f p;
        Mat3f R;
        SmoothedSplat<float> smooth;
        ViewEllipse e;
    };
    TVSGS_HD bool find(int i, Found& f) const {
        f.p = view.camera.camera_from_world * means[i];
        if (!(f.p.z > view.near) || !is_finite(f.p)) return false;
        f.smooth = smoothed_at(filter, i, log_scales[i]);
        const float opacity = f.smooth.dimming * sigmoid(opacity_logits[i]);
        if (!(opacity > kMinAlpha)) return false;
        f.R = rotation(normalize(quats[i]));
        f.e = view_ellipse(view, f.p, f.R, f.smooth.scales, opacity, kLeastRadeDet);
        return f.e.rect.count() != 0;
    }
    TVSGS_HD float radius(const Found& f) const { return f.e.radius; }
    TVSGS_HD void store(int /*i*/, const Found& f, std::uint32_t at) const {
        to.shapes[at] = f.e.shape;
        to.depths[at] = f.p.z;
        to.rects[at] = f.e.rect;
        RadeRecord& out = to.features[at];
        out.f.color = {};  // a render without colours also blends it
        if (!maps) return;
        const Mat3f& to_camera = view.camera.camera_from_world.R;
        const auto plane = rade_plane(view.camera, {to_camera * f.R, f.smooth.scales}, f.p);
        out.f.normal = plane.normal, out.f.distance = plane.distance;
        out.slope = plane.slope;
    }
};

/// Gradients of the parameters from the sums of each splat.
template <Channels kChannels>
struct RadeVjp {
    static constexpr bool kColor = has_color(kChannels), kMaps = has_plane(kChannels);
    using Sums = RadeGradients<float>;

    ViewParameters view;
    Span<const SplatShape<float>> shapes;
    Span<const RadeRecord> features;
    SplatSums<Sums> sums;
    Span<const float> filter;  // [N] or empty

    template <class Visit>
    TVSGS_HD bool operator()(int i,
                             const SplatGeometry& splat,
                             SplatGeometry& sum,
                             Visit& visit) const {
        Sums all;
        std::uint32_t at = 0;
        if (!finish(i, at, all)) return false;
        const SplatGradients<float>& g = all.of;
        Vec3f dL_dmean{};
        if constexpr (kColor)
            dL_dmean = sh_color_vjp<float>(view.sh_degree, splat.mean - view.centre,
                                           features[at].f.color, g.features.color, visit);
        const SplatShape<float> shape = shapes[at];
        const Vec3f p = view.camera.camera_from_world * splat.mean;
        const Mat3f& to_camera = view.camera.camera_from_world.R;
        const Mat3f R = rotation(normalize(splat.quat));
        const SmoothedSplat<float> smooth = smoothed_at(filter, i, splat.log_scale);

        auto ellipse = image_ellipse_vjp(projection_jacobian(view.camera, p), R, smooth.scales,
                                         shape.root, g.spread);
        Vec3f dL_dp = projection_vjp(view.camera, p, g.mean, ellipse.dL_dT);
        if constexpr (kMaps) {
            const auto plane = rade_plane_vjp(view.camera, {to_camera * R, smooth.scales}, p,
                                              {g.features.normal, all.slope, g.features.distance});
            dL_dp += plane.dL_dp;
            ellipse.dL_dlog_s += plane.dL_dlog_scales;
            const Mat3f by_R = transpose(to_camera) * plane.dL_daxes;
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c) ellipse.dL_dR[r][c] += by_R[r][c];
        }
        sum.log_scale += smoothed_vjp(smooth, shape.opacity, ellipse.dL_dlog_s, g.opacity);
        sum.opacity_logit += smooth.dimming * sigmoid_slope(splat.opacity_logit) * g.opacity;
        add(sum.quat, rotation_vjp(splat.quat, ellipse.dL_dR));
        sum.mean += transpose_times(to_camera, dL_dp) + dL_dmean;
        return true;
    }

    TVSGS_HD bool finish(int i, std::uint32_t& at, Sums& all) const {
        if (!sums.take(i, at, all)) return false;
        SplatGradients<float>& g = all.of;
        complete(g, shapes[at]);
        if constexpr (kMaps) g.mean += g.features.distance * features[at].slope;
        sums.write(i, per_ndc(view.grid, g.mean), per_ndc(view.grid, g.abs_mean), g.front_pixels);
        return true;
    }
};

}  // namespace tvsgs
