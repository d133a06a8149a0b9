// The splats of one view: per-Gaussian projection and its backward, one body for both devices.
#pragma once

#include "core/parallel.h"
#include "render/blend_ewa.h"
#include "render/projection_math.h"
#include "render/ray_depth.h"
#include "render/sh_math.h"

namespace tvsgs {

/// What the projection of a Gaussian needs to know of the view.
struct ViewParameters {
    Pinhole<float> camera;
    Vec3f centre;  // of the camera, world
    TileGrid grid;
    int sh_degree;
    float near, low_pass, cull_alpha;
    bool exact_clamp;
};

/// Where a splat is in the image. No tiles: it is not in view, and the rest means nothing.
struct ViewEllipse {
    SplatShape<float> shape;
    TileRect rect;
    float radius;  // the 3-sigma radius of 3DGS, px: statistics only, tiles come from an exact test
};

/// Of a splat at `p`, in front of the camera; `R`: world_from_gaussian. It is not drawn where the
/// determinant of its covariance in the image, px^4, is not above `least_det`.
TVSGS_HD inline ViewEllipse view_ellipse(const ViewParameters& view,
                                         Vec3f p,
                                         const Mat3f& R,
                                         Vec3f scales,
                                         float opacity,
                                         float least_det) {
    ViewEllipse out{};
    const ImageEllipse<float> e =
        image_ellipse(projection_jacobian(view.camera, p), R, scales, view.low_pass);
    if (!(e.det > least_det) || !(e.det < 1e30f)) return out;
    out.shape = {project_point(view.camera, p), ellipse_root(e), opacity,
                 splat_reach(opacity, view.cull_alpha)};
    const TileGrid& grid = view.grid;
    const TileRect rect = tile_rect(out.shape.mean, splat_extent(out.shape), grid);
    // Which of the tiles it meets is tested where their lists are built.
    if (rect.count() == 0 || !meets_tiles(out.shape, grid, rect)) return out;
    out.rect = rect;
    const float mid = 0.5f * (e.covariance.xx + e.covariance.yy);
    const float under_root = mid * mid - e.det;
    out.radius = std::ceil(3 * std::sqrt(mid + std::sqrt(under_root > 0.1f ? under_root : 0.1f)));
    return out;
}

template <Channels kChannels>
struct ProjectBody {
    ViewParameters view;
    Span<const Vec3f> means, log_scales;
    Span<const Quatf> quats;
    Span<const float> opacity_logits;
    Span<SplatShape<float>> shapes;
    Span<FeatureRecord> features;
    Span<float> depths;
    Span<TileRect> rects;
    Span<float> radii;

    TVSGS_HD void operator()(int i) const {
        rects[i] = {};
        radii[i] = 0;
        const Vec3f p = view.camera.camera_from_world * means[i];
        if (!(p.z > view.near) || !is_finite(p)) return;
        const float opacity = sigmoid(opacity_logits[i]);
        if (!(opacity > view.cull_alpha)) return;  // nowhere visible

        const Mat3f R = rotation(normalize(quats[i]));
        const ViewEllipse e =
            view_ellipse(view, p, R, exp(log_scales[i]), opacity, /*least_det=*/0);
        if (e.rect.count() == 0) return;
        radii[i] = e.radius;
        SplatShape<float>& shape = shapes[i];  // as a whole nvcc copies it byte by byte
        shape.mean = e.shape.mean, shape.root = e.shape.root;
        shape.opacity = e.shape.opacity, shape.reach = e.shape.reach;
        depths[i] = p.z;
        rects[i] = e.rect;

        if constexpr (has_plane(kChannels)) {
            const CameraPlane<float> plane =
                camera_plane(view.camera.camera_from_world.R, R, smallest_axis(log_scales[i]), p);
            features[i].f.normal = plane.normal;
            features[i].f.distance = plane.distance;
        }
    }
};

/// Colours of the splats in view; a pass of its own, so that renders without colour skip it.
struct ColorBody {
    ViewParameters view;
    Span<const Vec3f> means, sh;
    Span<const float> radii;
    Span<FeatureRecord> features;

    TVSGS_HD void operator()(int i) const {
        if (radii[i] > 0)
            features[i].f.color = sh_color<float>(view.sh_degree, normalize(means[i] - view.centre),
                                                  sh.data, means.count, i);
    }
};

/// The gradients of a view's splats as they appear in the image, and what is needed to carry them
/// to the Gaussians' parameters. All [N]; `fragments` and `drawn` have an entry per fragment.
struct ViewGradients {
    ViewParameters view;
    Channels channels;
    Span<const SplatShape<float>> shapes;
    Span<const FeatureRecord> features;
    Span<const std::uint32_t> fragment_counts, first_fragment;
    Span<const SplatGradients<float>> fragments;
    Span<const std::uint8_t> drawn;   // 0: the gradient is not written
    Span<Vec2f> stat_grad, stat_abs;  // overwritten
    Span<int> stat_front;
    Span<const RayDepthGradients>
        ray_fragments;  // as `fragments`; none where depth has no gradient
    Span<const std::uint8_t> ray_drawn;

    /// Null if depth says nothing of Gaussian i, which drew something.
    TVSGS_HD const RayDepthGradients* ray_gradients(int i) const {
        if (ray_fragments.empty() || !ray_drawn[first_fragment[i]]) return nullptr;
        return &ray_fragments[first_fragment[i]];
    }

    /// Completes the gradients of Gaussian i and writes its statistics, those of absolute values
    /// without depth along rays. False if it drew nothing: `g` is then unchanged, and the
    /// statistics are zero.
    template <Channels kChannels>
    TVSGS_HD bool finish(int i, SplatGradients<float>& g) const {
        if (fragment_counts[i] == 0 || !drawn[first_fragment[i]]) {
            stat_grad[i] = stat_abs[i] = {};
            stat_front[i] = 0;
            return false;
        }
        g = fragments[first_fragment[i]];
        if constexpr (has_ray(kChannels)) {
            if (const RayDepthGradients* const by_depth = ray_gradients(i)) {
                g.mean += by_depth->mean, g.opacity += by_depth->opacity;
                g.spread.xx += by_depth->spread.xx, g.spread.xy += by_depth->spread.xy;
                g.spread.yy += by_depth->spread.yy;
            }
        }
        complete(g, shapes[i]);
        const float half_w = 0.5f * static_cast<float>(view.grid.width),
                    half_h = 0.5f * static_cast<float>(view.grid.height);
        stat_grad[i] = {half_w * g.mean.x, half_h * g.mean.y};
        stat_abs[i] = {half_w * g.abs_mean.x, half_h * g.abs_mean.y};
        stat_front[i] = static_cast<int>(g.front_pixels);
        return true;
    }
};

/// The statistics alone.
template <Channels kChannels>
struct StatisticsBody {
    ViewGradients in;
    TVSGS_HD void operator()(int i) const {
        SplatGradients<float> g;
        in.finish<kChannels>(i, g);
    }
};
template <class Device>
void write_statistics(Device device, const ViewGradients& in) {
    with_channels(in.channels, [&]<Channels kChannels>() {
        parallel_for(device, in.shapes.size(), StatisticsBody<kChannels>{in});
    });
}

/// The parameters of one Gaussian but its colour, or their gradients.
struct SplatGeometry {
    Vec3f mean, log_scale;
    Quatf quat;
    float opacity_logit;
};
TVSGS_HD inline SplatGeometry no_gradient() {
    return {{}, {}, {0, 0, 0, 0}, 0};  // Quatf{} is the identity
}
TVSGS_HD inline void add(Quatf& sum, const Quatf& q) {
    sum.w += q.w, sum.x += q.x, sum.y += q.y, sum.z += q.z;
}
TVSGS_HD inline void add(SplatGeometry& sum, const SplatGeometry& g) {
    sum.mean += g.mean, sum.log_scale += g.log_scale;
    add(sum.quat, g.quat);
    sum.opacity_logit += g.opacity_logit;
}

/// Adds the gradients of Gaussian i to `sum`; `visit` as sh_color_vjp takes it. False if it drew
/// nothing: nothing is added or visited then.
template <Channels kChannels, class Visit>
TVSGS_HD bool splat_vjp(
    const ViewGradients& in, int i, const SplatGeometry& splat, SplatGeometry& sum, Visit& visit) {
    SplatGradients<float> g;
    if (!in.finish<kChannels>(i, g)) return false;
    const ViewParameters& view = in.view;
    Vec3f dL_dmean{};  // the harmonics first: they hold most numbers at once
    if constexpr (has_color(kChannels))
        dL_dmean = sh_color_vjp<float>(view.sh_degree, splat.mean - view.centre,
                                       in.features[i].f.color, g.features.color, visit);
    const Vec3f p = view.camera.camera_from_world * splat.mean;
    const Mat3f R = rotation(normalize(splat.quat));
    const Vec3f scales = exp(splat.log_scale);
    const SplatShape<float> shape = in.shapes[i];
    sum.opacity_logit += sigmoid_slope(splat.opacity_logit) * g.opacity;

    auto ellipse =
        image_ellipse_vjp(projection_jacobian(view.camera, p), R, scales, shape.root, g.spread);
    Vec3f dL_dp = projection_vjp(view.camera, p, g.mean, ellipse.dL_dT, view.exact_clamp);
    if constexpr (has_plane(kChannels)) {
        const int axis = smallest_axis(splat.log_scale);
        const auto plane = camera_plane_vjp(view.camera.camera_from_world.R, R, axis, p,
                                            g.features.normal, g.features.distance);
        dL_dp += plane.dL_dmean_camera;
        for (int k = 0; k < 3; ++k) {
            const float here = k == axis ? 1.0f : 0.0f;
            ellipse.dL_dR[0][k] += here * plane.dL_daxis.x;
            ellipse.dL_dR[1][k] += here * plane.dL_daxis.y;
            ellipse.dL_dR[2][k] += here * plane.dL_daxis.z;
        }
    }
    if constexpr (has_ray(kChannels)) {
        if (const RayDepthGradients* const by_depth = in.ray_gradients(i)) {
            const auto ray = ray_profile_vjp(view.camera, R, scales, p, by_depth->profile);
            dL_dp += ray.dL_dp;
            ellipse.dL_dlog_s += ray.dL_dlog_s;
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c) ellipse.dL_dR[r][c] += ray.dL_dR[r][c];
        }
    }
    sum.mean += dL_dmean + transpose_times(view.camera.camera_from_world.R, dL_dp);
    sum.log_scale += ellipse.dL_dlog_s;
    add(sum.quat, rotation_vjp(splat.quat, ellipse.dL_dR));
    return true;
}

/// Adds the gradients of the Gaussians to arrays.
template <Channels kChannels>
struct ProjectBackwardBody {
    ViewGradients in;
    Span<const Vec3f> means, log_scales;
    Span<const Quatf> quats;
    Span<const float> opacity_logits;
    Span<const Vec3f> sh;
    Span<Vec3f> dL_dmeans, dL_dlog_scales;
    Span<Quatf> dL_dquats;
    Span<float> dL_dopacity_logits;
    Span<Vec3f> dL_dsh;

    TVSGS_HD void operator()(int i) const {
        SplatGeometry sum = no_gradient();
        AddShGradient<float> visit{sh.data, dL_dsh.data, means.count, static_cast<std::size_t>(i)};
        const SplatGeometry splat{means[i], log_scales[i], quats[i], opacity_logits[i]};
        if (!splat_vjp<kChannels>(in, i, splat, sum, visit)) return;
        dL_dmeans[i] += sum.mean;
        dL_dlog_scales[i] += sum.log_scale;
        dL_dopacity_logits[i] += sum.opacity_logit;
        add(dL_dquats[i], sum.quat);
    }
};

}  // namespace tvsgs
