// Second half of the backward pass, shared by all rasterisers: from the sums of the splats over
// pixels to the gradients of their parameters.
#pragma once

#include <concepts>

#include "core/device/parallel.h"
#include "render/tiles/blend.h"
#include "render/tiles/camera_math.h"
#include "render/tiles/sh_math.h"
#include "render/tiles/splat_places.h"

namespace tvsgs {

/// The parameters of one Gaussian without SH coefficients, or their gradients.
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

/// The same of all Gaussians.
struct SplatParameters {
    Span<const Vec3f> means, log_scales;
    Span<const Quatf> quats;
    Span<const float> opacity_logits;

    TVSGS_HD SplatGeometry geometry(int i) const {
        return {means[i], log_scales[i], quats[i], opacity_logits[i]};
    }
};
template <class Device>
SplatParameters parameters_of(const Gaussians<Device>& g) {
    return {g.means.span(), g.log_scales.span(), g.quats.span(), g.opacity_logits.span()};
}

/// Converts a gradient per px to one per NDC unit.
TVSGS_HD inline Vec2f per_ndc(const TileGrid& grid, Vec2f per_px) {
    return {0.5f * float(grid.width) * per_px.x, 0.5f * float(grid.height) * per_px.y};
}

/// Sums of the splats over pixels, as in FragmentGradients, and destinations of their statistics.
template <class Gradients>
struct SplatSums {
    SplatPlaces places;
    Span<const std::uint32_t> fragment_counts, first_fragment;  // by place
    Span<const Gradients> fragments;
    Span<const std::uint8_t> drawn;
    Span<Vec2f> stat_grad, stat_abs;  // [N], overwritten: ScreenStatistics
    Span<int> stat_front;

    /// Returns the sums of splat i and the place of its records. False if it drew nothing; then it
    /// writes statistics of 0.
    TVSGS_HD bool take(int i, std::uint32_t& place, Gradients& sum) const {
        place = places.of(i);
        if (place < fragment_counts.count && fragment_counts[place] != 0 &&
            drawn[first_fragment[place]]) {
            sum = fragments[first_fragment[place]];
            return true;
        }
        write(i, {}, {}, 0);
        return false;
    }
    /// Overwrites the screen statistics of splat i.
    TVSGS_HD void write(int i, Vec2f by_ndc, Vec2f abs_by_ndc, float front_pixels) const {
        stat_grad[i] = by_ndc, stat_abs[i] = abs_by_ndc;
        stat_front[i] = int(front_pixels);
    }
};

/// Second half of the backward pass for one rasteriser and one set of maps, for both devices:
///
///   kColor     true if there are gradients of SH coefficients
///   sums       a SplatSums
///   vjp(i, splat, sum, visit)  adds the gradients of Gaussian i (parameters: `splat`) to `sum`,
///              passes SH gradients to `visit` as sh_color_vjp() does, and writes its statistics.
///              Returns false, without adding or visiting, if it drew nothing
///   finish(i, place, sums)  writes only the statistics; `Sums`: completed sums of a Gaussian.
///              Returns false if it drew nothing
template <class Vjp>
concept SplatVjp = requires(const Vjp& vjp,
                            const SplatGeometry& splat,
                            SplatGeometry& sum,
                            AddShGradient<float>& visit,
                            std::uint32_t place,
                            typename Vjp::Sums sums) {
    { Vjp::kColor } -> std::convertible_to<bool>;
    { vjp(0, splat, sum, visit) } -> std::same_as<bool>;
    { vjp.finish(0, place, sums) } -> std::same_as<bool>;
    vjp.sums.places.of(0);
};

template <SplatVjp Vjp>
struct AddGradientsBody {
    Vjp vjp;
    SplatParameters splats;
    Span<const Vec3f> sh;
    Span<Vec3f> dL_dmeans, dL_dlog_scales;
    Span<Quatf> dL_dquats;
    Span<float> dL_dopacity_logits;
    Span<Vec3f> dL_dsh;  // may be empty without colour

    TVSGS_HD void operator()(int i) const {
        SplatGeometry sum = no_gradient();
        AddShGradient<float> visit{sh.data, dL_dsh.data, splats.means.count, std::size_t(i)};
        if (!vjp(i, splats.geometry(i), sum, visit)) return;
        dL_dmeans[i] += sum.mean;
        dL_dlog_scales[i] += sum.log_scale;
        dL_dopacity_logits[i] += sum.opacity_logit;
        add(dL_dquats[i], sum.quat);
    }
};

/// Visitor that ignores gradients of SH coefficients; the camera only needs dL_ddirection.
struct CameraVisit {
    static constexpr int kGroup = 1;
    const Vec3f* sh;
    std::size_t stride, i;
    Vec3f dL_ddirection{};

    TVSGS_HD void operator()(int k,
                             const Vec3f (&/*gradient*/)[kGroup],
                             Vec3f (&values)[kGroup]) const {
        values[0] = sh[std::size_t(k) * stride + i];
    }
};

template <SplatVjp Vjp>
struct CameraGradientBody {
    Vjp vjp;
    Mat3f camera_from_world;
    Vec3f centre;  // of the camera
    SplatParameters splats;
    Span<const Vec3f> sh;
    Span<CameraGradient<float>> gradients;  // [N] overwritten

    TVSGS_HD void operator()(int i) const {
        gradients[i] = {};
        SplatGeometry sum = no_gradient();
        CameraVisit visit{sh.data, splats.means.count, std::size_t(i)};
        const SplatGeometry splat = splats.geometry(i);
        if (!vjp(i, splat, sum, visit)) return;
        gradients[i] = camera_gradient(camera_from_world, splat.mean - centre, sum.mean,
                                       visit.dL_ddirection, splat.quat, sum.quat);
    }
};
struct CameraGradientTerm {
    Span<const CameraGradient<float>> gradients;
    int k;
    TVSGS_HD float operator()(int i) const { return component(gradients[i], k); }
};

template <SplatVjp Vjp>
struct ObserveBody {
    Vjp vjp;
    TVSGS_HD void operator()(int i) const {
        typename Vjp::Sums sums;
        std::uint32_t place = 0;
        vjp.finish(i, place, sums);
    }
};

}  // namespace tvsgs
