// Splats of one view of the backbone `surfel`, for both devices: projection to the image, and
// gradients of the parameters from their sums over pixels.  [2DGS]
#pragma once

#include "render/surfel/blend_surfel.h"
#include "render/tiles/blend_math.h"
#include "render/tiles/splat_vjp.h"
#include "render/tiles/view_splats.h"

namespace tvsgs {

/// A splat in the camera's frame. `sign`: turns the normal towards the camera; 0: edge on.
struct SurfelPose {
    SurfelAxes<float> axes;
    Mat3f R;  // of the splat in the world
    Vec3f normal;
    float sign;
};
TVSGS_HD inline SurfelPose surfel_pose(const ViewParameters& view,
                                       Vec3f mean,
                                       Vec3f log_scale,
                                       Quatf quat) {
    SurfelPose pose;
    const Mat3f& to_camera = view.camera.camera_from_world.R;
    pose.R = rotation(normalize(quat));
    pose.axes.centre = view.camera.camera_from_world * mean;
    pose.axes.a = std::exp(log_scale.x) * (to_camera * column(pose.R, 0));
    pose.axes.b = std::exp(log_scale.y) * (to_camera * column(pose.R, 1));
    const Vec3f normal = to_camera * column(pose.R, 2);
    const float facing = dot(normal, pose.axes.centre);
    pose.sign = facing < 0 ? 1.0f : facing > 0 ? -1.0f : 0.0f;
    pose.normal = pose.sign * normal;
    return pose;
}

/// Projection of splats; see splat_places.h.
struct ProjectSurfelsBody : SplatParameters {
    ViewParameters view;
    ViewRecords<SurfelShape<float>, SurfelRecord> to;
    ColorShare color_share;

    struct Found {
        SurfelPose pose;
        SurfelShape<float> shape;
        TileRect rect;
    };
    TVSGS_HD bool find(int i, Found& f) const {
        f.pose = surfel_pose(view, means[i], log_scales[i], quats[i]);
        const Vec3f p = f.pose.axes.centre;
        if (!(p.z > view.near) || !is_finite(p) || f.pose.sign == 0) return false;
        const float opacity = sigmoid(opacity_logits[i]);
        if (!(opacity > kLeastSurfelAlpha)) return false;
        SurfelShape<float>& s = f.shape;
        if (!surfel_shape(view.camera, f.pose.axes, opacity, s)) return false;
        const Vec2f half{0.5f * (s.high.x - s.low.x), 0.5f * (s.high.y - s.low.y)};
        if (!(half.x < 1e6f) || !(half.y < 1e6f)) return false;
        f.rect =
            tile_rect({s.mean.x + s.low.x + half.x, s.mean.y + s.low.y + half.y}, half, view.grid);
        return f.rect.count() != 0;
    }
    TVSGS_HD float radius(const Found& f) const {
        const SurfelBox<float> box =
            surfel_box(surfel_rows(view.camera, f.pose.axes), kLowPassReach);
        const float longer = box.extent.x > box.extent.y ? box.extent.x : box.extent.y;
        const float least = kLowPassReach * 0.70710678f;
        return std::ceil(longer > least ? longer : least);
    }
    TVSGS_HD void store(int i, const Found& found, std::uint32_t at) const {
        to.shapes[at] = found.shape;
        to.depths[at] = found.pose.axes.centre.z;
        to.rects[at] = found.rect;
        to.features[at].color_share = color_share(i);
        SurfelFeatures<float>& f = to.features[at].f;
        f.normal = found.pose.normal;
        f.color = {};  // a render without colours also blends it
    }
};

/// Gradients of the parameters from the sums of each splat. The third scale has no gradient.
template <Channels kChannels>
struct SurfelVjp {
    static constexpr bool kColor = has_color(kChannels), kMaps = has_plane(kChannels);
    using Gradients = SurfelGradients<kMaps, float>;
    struct Sums {
        Gradients of;
        SurfelMatrixGradient<float> matrix;
    };

    ViewParameters view;
    Span<const SurfelShape<float>> shapes;
    Span<const SurfelRecord> features;
    SplatSums<Gradients> sums;

    template <class Visit>
    TVSGS_HD bool operator()(int i,
                             const SplatGeometry& splat,
                             SplatGeometry& sum,
                             Visit& visit) const {
        Sums all;
        std::uint32_t at = 0;
        if (!finish(i, at, all)) return false;
        const Gradients& g = all.of;
        SurfelMatrixGradient<float>& matrix = all.matrix;
        Vec3f dL_dmean{};
        if constexpr (kColor)
            dL_dmean = features[at].color_share *
                       sh_color_vjp<float>(view.sh_degree, splat.mean - view.centre,
                                           features[at].f.color, g.color, visit);
        if constexpr (kMaps) matrix.row_z.z += g.depth;
        const SurfelPose pose = surfel_pose(view, splat.mean, splat.log_scale, splat.quat);
        low_pass_vjp(surfel_rows(view.camera, pose.axes), shapes[at].low_pass, g.inverse.low_pass,
                     matrix);
        const SurfelAxes<float> axes = surfel_axes_vjp(view.camera, pose.axes.centre, matrix);
        const Mat3f& to_camera = view.camera.camera_from_world.R;
        sum.log_scale.x += dot(axes.a, pose.axes.a);
        sum.log_scale.y += dot(axes.b, pose.axes.b);
        Vec3f by_normal{};
        if constexpr (kMaps) by_normal = pose.sign * transpose_times(to_camera, g.normal);
        const Vec3f by_axis[3] = {std::exp(splat.log_scale.x) * transpose_times(to_camera, axes.a),
                                  std::exp(splat.log_scale.y) * transpose_times(to_camera, axes.b),
                                  by_normal};
        Mat3f dL_dR;
        for (int r = 0; r < 3; ++r)
            for (int c = 0; c < 3; ++c) dL_dR[r][c] = by_axis[c][r];
        add(sum.quat, rotation_vjp(splat.quat, dL_dR));
        sum.opacity_logit += sigmoid_slope(splat.opacity_logit) * g.opacity;
        sum.mean += transpose_times(to_camera, axes.centre) + dL_dmean;
        return true;
    }

    TVSGS_HD bool finish(int i, std::uint32_t& at, Sums& all) const {
        if (!sums.take(i, at, all.of)) return false;
        const SurfelShape<float> s = shapes[at];
        all.matrix = surfel_inverse_vjp(s, all.of.inverse);
        // Surrogate for the derivative by the centre's position, without the part drawn as a dot.
        const Vec2f by_place = per_ndc(view.grid, {all.matrix.row_x.z, all.matrix.row_y.z});
        const Vec2f by_ndc{by_place.x / s.inverse_depth, by_place.y / s.inverse_depth};
        sums.write(i, by_ndc, {std::abs(by_ndc.x), std::abs(by_ndc.y)}, all.of.front_pixels);
        return true;
    }
};

}  // namespace tvsgs
