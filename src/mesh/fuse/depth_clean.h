// Drops pixels of a rendered depth map that should not be fused.
#pragma once

#include <cstdint>

#include "core/device/buffer.h"
#include "mesh/fuse/pixel_trust.h"
#include "mesh/fuse/tsdf_math.h"
#include "render/backbone.h"

namespace tvsgs {

struct DepthRules {
    float depth_max = 0;   // depths from there on are dropped
    float depth_step = 0;  // kept depths are rounded down to multiples of it; 0: not rounded
    float alpha_min = 0;   // least coverage; 0: any
    float min_cosine = 0;  // least cosine between the ray and the blended normal; 0: any
    bool has_box = false;
    Vec3f box_min, box_max;  // surface points outside are dropped
    float reach = 0;         // of a contracted volume, from its centre; 0: any
    Vec3f centre;
    DepthWeighting weighting = DepthWeighting::unit;
    // Compute the weights of mesh/fuse/pixel_trust.h; needs DepthWeighting::unit.
    bool trust = false;
    float jump_px = kJumpPx;  // largest depth jump beside a trusted pixel

    /// True if there is no box. NaN is outside.
    TVSGS_HD bool in_box(Vec3f p) const {
        if (!has_box) return true;
        for (int axis = 0; axis < 3; ++axis)
            if (!(p[axis] >= box_min[axis] && p[axis] <= box_max[axis])) return false;
        return true;
    }
};

/// Number of pixels by the first rule that drops them.
struct DepthCounts {
    std::int64_t kept = 0, not_finite = 0, no_surface = 0, too_far = 0, transparent = 0, masked = 0,
                 grazing = 0, outside = 0, out_of_reach = 0;
};
DepthCounts& operator+=(DepthCounts& a, const DepthCounts& b);

/// The depth map of a view, ready for fusion.
template <class Device>
struct CleanDepth {
    Buffer<float, Device> depth;            // [H W] 0: dropped
    Buffer<float, Device> weight;           // [H W]; empty: 1
    Buffer<std::uint8_t, Device> outcomes;  // [H W] the rule that dropped the pixel
};

/// Applies the rules to a rendered depth map; `clean` is resized and overwritten. `mask` ([H W],
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

/// Counts the entries of CleanDepth::outcomes.
DepthCounts count_outcomes(const std::vector<std::uint8_t>& outcomes);

}  // namespace tvsgs
