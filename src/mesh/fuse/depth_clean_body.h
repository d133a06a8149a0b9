// The per-pixel work of clean_depth, shared by CPU and CUDA.
#pragma once

#include "core/device/parallel.h"
#include "core/scene/scene.h"
#include "mesh/fuse/depth_clean.h"

namespace tvsgs {

struct CleanDepthBody {
    Camera camera;
    DepthRules rules;
    Span<const float> rendered_depth, transmittance;
    Span<const Vec3f> normals;
    Span<const std::uint8_t> mask;
    Span<float> depth;
    Span<DepthOutcome> outcomes;

    TVSGS_HD DepthOutcome outcome(int i) const {
        const float d = rendered_depth[i];
        if (!(d - d == 0)) return DepthOutcome::not_finite;
        if (!(d > 0)) return DepthOutcome::no_surface;
        if (!(d < rules.depth_max)) return DepthOutcome::too_far;
        if (rules.alpha_min > 0 && !(1 - transmittance[i] >= rules.alpha_min))
            return DepthOutcome::transparent;
        if (!mask.empty() && mask[i] < kObjectMask) return DepthOutcome::masked;
        if (rules.min_cosine > 0) {
            const Vec3f ray = pixel_ray(camera, i % camera.width_px, i / camera.width_px);
            const Vec3f n = normals[i];
            if (!(-dot(ray, n) >= rules.min_cosine * norm(ray) * norm(n)) || !(norm(n) > 0))
                return DepthOutcome::grazing;
        }
        const Vec3f p = unproject(camera, i % camera.width_px, i / camera.width_px, d);
        if (!rules.in_box(p)) return DepthOutcome::outside;
        if (rules.reach > 0 && !(norm(p - rules.centre) < rules.reach))
            return DepthOutcome::out_of_reach;
        return DepthOutcome::kept;
    }
    TVSGS_HD void operator()(int i) const {
        outcomes[i] = outcome(i);
        float kept = outcomes[i] == DepthOutcome::kept ? rendered_depth[i] : 0;
        if (rules.depth_step > 0) kept = std::floor(kept / rules.depth_step) * rules.depth_step;
        depth[i] = kept;
    }
};

template <class Device>
DepthCounts clean_depth(const RenderedImages<Device>& rendered,
                        const Camera& camera,
                        Span<const std::uint8_t> mask,
                        const DepthRules& rules,
                        CleanDepth<Device>& clean) {
    const std::size_t pixels = rendered.depth.size();
    clean.depth.resize(pixels), clean.outcomes.resize(pixels);
    clean.weight.resize(rules.trust ? pixels : 0);
    parallel_for(
        Device{}, static_cast<int>(pixels),
        CleanDepthBody{camera, rules, rendered.depth.span(), rendered.transmittance.span(),
                       rendered.normal.span(), mask, clean.depth.span(), clean.outcomes.span()});
    if (rules.trust)
        parallel_for(Device{}, static_cast<int>(pixels),
                     PixelTrustBody{camera, clean.depth.span(), rendered.depth.span(),
                                    rendered.normal.span(), clean.weight.span(), rules.jump_px});
    DepthCounts counts;
    for (const DepthOutcome outcome : to_host(clean.outcomes))
        ++counts.of[static_cast<std::size_t>(outcome)];
    return counts;
}

}  // namespace tvsgs
