// Which depths of a render are fit for fusion.
#pragma once

#include <cstdint>

#include "core/device/buffer.h"
#include "mesh/fuse/pixel_trust.h"
#include "mesh/fuse/tsdf_math.h"
#include "render/backbone.h"

namespace tvsgs {

struct DepthRules {
    float depth_max = 0;   // depths from there on are dropped
    float depth_step = 0;  // kept depths are rounded down to multiples of it; 0: not
    float alpha_min = 0;   // least coverage; 0: any
    float min_cosine = 0;  // least one between the ray and the blended normal; 0: any
    bool has_box = false;
    Vec3f box_min, box_max;  // surface points outside are dropped
    float reach = 0;         // of a contracted volume, from its centre; 0: any
    Vec3f centre;
    DepthWeighting weighting = DepthWeighting::unit;
    bool trust = false;       // weights are of mesh/fuse/pixel_trust.h; needs DepthWeighting::unit
    float jump_px = kJumpPx;  // largest beside a trusted pixel

    /// Also true without a box. NaN is outside.
    TVSGS_HD bool in_box(Vec3f p) const {
        if (!has_box) return true;
        for (int axis = 0; axis < 3; ++axis)
            if (!(p[axis] >= box_min[axis] && p[axis] <= box_max[axis])) return false;
        return true;
    }
};

/// What became of the pixels; each is counted once, under the first rule that drops it.
struct DepthCounts {
    std::int64_t kept = 0, not_finite = 0, no_surface = 0, too_far = 0, transparent = 0, masked = 0,
                 grazing = 0, outside = 0, out_of_reach = 0;
};
DepthCounts& operator+=(DepthCounts& a, const DepthCounts& b);

/// A view's depth as it is fused.
template <class Device>
struct CleanDepth {
    Buffer<float, Device> depth;         // [H W] 0: dropped
    Buffer<float, Device> weight;        // [H W]; empty: 1
    Buffer<std::uint8_t, Device> fates;  // [H W]
};

/// Renders' depth without what the rules drop; `clean` is resized and overwritten. `mask` ([H W],
/// 255 = object) may be empty.
DepthCounts clean_depth(const RenderedImages<Cpu>& rendered,
                        const Camera& camera,
                        Span<const std::uint8_t> mask,
                        const DepthRules& rules,
                        CleanDepth<Cpu>& clean);
DepthCounts clean_depth(const RenderedImages<Cuda>& rendered,
                        const Camera& camera,
                        Span<const std::uint8_t> mask,
                        const DepthRules& rules,
                        CleanDepth<Cuda>& clean);

/// The counts of the fates that clean_depth wrote.
DepthCounts count_fates(const std::vector<std::uint8_t>& fates);

}  // namespace tvsgs
