// Splats of one view of the backbone `ewa`, for both devices: projection to the image, and
// gradients of the parameters from their sums over pixels.
#pragma once

#include "render/ewa/blend_ewa.h"
#include "render/tiles/splat_vjp.h"
#include "render/tiles/view_splats.h"

namespace tvsgs {

/// Projection of splats; see splat_places.h.
template <Channels kChannels>
struct ProjectBody : SplatParameters {
    ViewParameters view;
    ViewRecords<SplatShape<float>, FeatureRecord> to;
    ColorShare color_share;

    struct Found {
        Vec3f p;
        Mat3f R;
        ViewEllipse e;
    };
    TVSGS_HD bool find(int i, Found& f) const {
        f.p = view.camera.camera_from_world * means[i];
        if (!(f.p.z > view.near) || !is_finite(f.p)) return false;
        const float opacity = sigmoid(opacity_logits[i]);
        if (!(opacity > kMinAlpha)) return false;  // nowhere visible
        f.R = rotation(normalize(quats[i]));
        f.e = view_ellipse(view, f.p, f.R, exp(log_scales[i]), opacity, /*least_det=*/0);
        return f.e.rect.count() != 0;
    }
    TVSGS_HD float radius(const Found& f) const { return f.e.radius; }
    TVSGS_HD void store(int i, const Found& f, std::uint32_t at) const {
        FeatureRecord& out = to.features[at];
        out.color_share = color_share(i);
        SplatShape<float>& shape = to.shapes[at];  // nvcc would copy it byte by byte
        shape.mean = f.e.shape.mean, shape.root = f.e.shape.root;
        shape.opacity = f.e.shape.opacity, shape.reach = f.e.shape.reach;
        to.depths[at] = f.p.z;
        to.rects[at] = f.e.rect;
        if constexpr (has_plane(kChannels)) {
            const CameraPlane<float> plane = camera_plane(view.camera.camera_from_world.R, f.R,
                                                          smallest_axis(log_scales[i]), f.p);
            out.f.normal = plane.normal, out.f.distance = plane.distance;
        }
    }
};

/// Gradients of the parameters from the sums of each splat.
template <Channels kChannels>
struct EwaVjp {
    static constexpr bool kColor = has_color(kChannels);
    using Sums = SplatGradients<float>;

    ViewParameters view;
    Span<const SplatShape<float>> shapes;
    Span<const FeatureRecord> features;
    SplatSums<Sums> sums;

    template <class Visit>
    TVSGS_HD bool operator()(int i,
                             const SplatGeometry& splat,
                             SplatGeometry& sum,
                             Visit& visit) const {
        Sums g;
        std::uint32_t at = 0;
        if (!finish(i, at, g)) return false;
        Vec3f dL_dmean{};  // SH first: it needs most registers
        if constexpr (kColor)
            dL_dmean = features[at].color_share *
                       sh_color_vjp<float>(view.sh_degree, splat.mean - view.centre,
                                           features[at].f.color, g.features.color, visit);
        const Vec3f p = view.camera.camera_from_world * splat.mean;
        const Mat3f R = rotation(normalize(splat.quat));
        const Vec3f scales = exp(splat.log_scale);
        const SplatShape<float> shape = shapes[at];
        sum.opacity_logit += sigmoid_slope(splat.opacity_logit) * g.opacity;

        auto ellipse =
            image_ellipse_vjp(projection_jacobian(view.camera, p), R, scales, shape.root, g.spread);
        Vec3f dL_dp = projection_vjp(view.camera, p, g.mean, ellipse.dL_dT);
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
        sum.mean += dL_dmean + transpose_times(view.camera.camera_from_world.R, dL_dp);
        sum.log_scale += ellipse.dL_dlog_s;
        add(sum.quat, rotation_vjp(splat.quat, ellipse.dL_dR));
        return true;
    }

    TVSGS_HD bool finish(int i, std::uint32_t& at, Sums& g) const {
        if (!sums.take(i, at, g)) return false;
        complete(g, shapes[at]);
        sums.write(i, per_ndc(view.grid, g.mean), per_ndc(view.grid, g.abs_mean), g.front_pixels);
        return true;
    }
};

}  // namespace tvsgs
