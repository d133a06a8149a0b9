// What both twins of clean_depth do for one pixel.
#pragma once

#include "core/parallel.h"
#include "core/scene.h"
#include "mesh/depth_clean.h"
#include "mesh/depth_filter.h"

namespace tvsgs {

enum class DepthFate : std::uint8_t {
    kept,
    not_finite,
    no_surface,
    too_far,
    transparent,
    masked,
    grazing,
    outside,
    out_of_reach
};

/// Which depths the rules keep, as they are.
struct CleanDepthBody {
    Camera camera;
    DepthRules rules;
    Span<const float> rendered_depth, transmittance;
    Span<const Vec3f> normals;
    Span<const std::uint8_t> mask;
    Span<float> depth;
    Span<std::uint8_t> fates;

    /// Of pixel i, with depth d.
    TVSGS_HD DepthFate fate(int i, float d) const {
        if (!(d - d == 0)) return DepthFate::not_finite;
        if (!(d > 0)) return DepthFate::no_surface;
        if (!(d < rules.depth_max)) return DepthFate::too_far;
        if (rules.alpha_min > 0 && !(1 - transmittance[i] >= rules.alpha_min))
            return DepthFate::transparent;
        if (!mask.empty() && mask[i] < kObjectMask) return DepthFate::masked;
        if (rules.min_cosine > 0) {
            const Vec3f ray = pixel_ray(camera, i % camera.width_px, i / camera.width_px);
            const Vec3f n = normals[i];
            if (!(-dot(ray, n) >= rules.min_cosine * norm(ray) * norm(n)) || !(norm(n) > 0))
                return DepthFate::grazing;
        }
        const Vec3f p = unproject(camera, i % camera.width_px, i / camera.width_px, d);
        if (!rules.in_box(p)) return DepthFate::outside;
        if (rules.reach > 0 && !(norm(p - rules.centre) < rules.reach))
            return DepthFate::out_of_reach;
        return DepthFate::kept;
    }
    TVSGS_HD void operator()(int i) const {
        const DepthFate result = fate(i, rendered_depth[i]);
        fates[i] = static_cast<std::uint8_t>(result);
        depth[i] = result == DepthFate::kept ? rendered_depth[i] : 0;
    }
};

/// Takes filtered depths where the rules keep them, too.
struct TakeFilteredBody {
    CleanDepthBody clean;
    Span<const float> filtered;

    TVSGS_HD void operator()(int i) const {
        if (clean.depth[i] > 0 && clean.fate(i, filtered[i]) == DepthFate::kept)
            clean.depth[i] = filtered[i];
    }
};

/// Rounds depths, and weighs them if `weight` is not empty.
struct FinishDepthBody {
    Camera camera;
    DepthRules rules;
    Span<const Vec3f> normals;
    Span<float> depth, weight;

    TVSGS_HD void operator()(int i) const {
        if (rules.depth_step > 0)
            depth[i] = std::floor(depth[i] / rules.depth_step) * rules.depth_step;
        if (!weight.empty())
            weight[i] = depth_weight(rules.weighting, depth[i],
                                     pixel_ray(camera, i % camera.width_px, i / camera.width_px),
                                     normals[i]);
    }
};

template <class Device>
DepthCounts clean_depth_on(const RenderedImages<Device>& rendered,
                           const Camera& camera,
                           Span<const std::uint8_t> mask,
                           const DepthRules& rules,
                           CleanDepth<Device>& clean) {
    const std::size_t pixels = rendered.depth.size();
    const auto for_pixels = [&](const auto& body) {
        parallel_for(Device{}, static_cast<int>(pixels), body);
    };
    clean.depth.resize(pixels), clean.fates.resize(pixels);
    clean.filtered.resize(rules.filter_px > 0 ? pixels : 0);
    const bool weighted = rules.weighting != DepthWeighting::unit;
    clean.weight.resize(weighted || rules.trust ? pixels : 0);

    const CleanDepthBody body{camera,
                              rules,
                              rendered.depth.span(),
                              rendered.transmittance.span(),
                              rendered.normal.span(),
                              mask,
                              clean.depth.span(),
                              clean.fates.span()};
    for_pixels(body);
    const PixelMaps maps{camera, std::as_const(clean.depth).span(), rendered.normal.span()};
    if (rules.filter_px > 0) {
        for_pixels(DepthFilterBody{maps, clean.filtered.span(), rules.filter_px});
        for_pixels(TakeFilteredBody{body, std::as_const(clean.filtered).span()});
    }
    if (rules.trust) for_pixels(PixelTrustBody{maps, clean.weight.span(), rules.jump_px});
    if (rules.depth_step > 0 || weighted)
        for_pixels(FinishDepthBody{camera, rules, rendered.normal.span(), clean.depth.span(),
                                   weighted ? clean.weight.span() : Span<float>{}});
    return count_fates(to_host(clean.fates));
}

}  // namespace tvsgs
