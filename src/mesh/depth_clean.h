// Which depths of a render are fit for fusion.
#pragma once

#include <cstdint>

#include "core/buffer.h"
#include "render/backbone.h"

namespace tvsgs {

struct DepthRules {
    float depth_max = 0;   // depths from there on are dropped
    float depth_step = 0;  // kept depths are rounded down to multiples of it; 0: not
    float alpha_min = 0;   // least coverage; 0: any
    float min_cosine = 0;  // least one between the ray and the blended normal; 0: any
    bool has_box = false;
    Vec3f box_min, box_max;  // surface points outside are dropped
};

/// What became of the pixels; each is counted once, under the first rule that drops it.
struct DepthCounts {
    std::int64_t kept = 0, not_finite = 0, no_surface = 0, too_far = 0, transparent = 0, masked = 0,
                 grazing = 0, outside = 0;
};
DepthCounts& operator+=(DepthCounts& a, const DepthCounts& b);

/// Renders' depth with 0 for what the rules drop; [H W], resized and overwritten. `mask` ([H W],
/// 255 = object) may be empty. `fates` is scratch.
DepthCounts clean_depth(const RenderedImages<Cpu>& rendered,
                        const Camera& camera,
                        Span<const std::uint8_t> mask,
                        const DepthRules& rules,
                        Buffer<float, Cpu>& depth,
                        Buffer<std::uint8_t, Cpu>& fates);
DepthCounts clean_depth(const RenderedImages<Cuda>& rendered,
                        const Camera& camera,
                        Span<const std::uint8_t> mask,
                        const DepthRules& rules,
                        Buffer<float, Cuda>& depth,
                        Buffer<std::uint8_t, Cuda>& fates);

/// The counts of the fates that clean_depth wrote.
DepthCounts count_fates(const std::vector<std::uint8_t>& fates);

}  // namespace tvsgs
