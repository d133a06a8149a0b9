// Drops pixels of a rendered depth map that should not be fused.
#pragma once

#include <array>
#include <cstdint>

#include "core/device/buffer.h"
#include "mesh/fuse/depth_view.h"
#include "mesh/fuse/pixel_trust.h"
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
    bool trust = false;       // compute the weights of mesh/fuse/pixel_trust.h
    float jump_px = kJumpPx;  // largest depth jump beside a trusted pixel

    /// True if there is no box. NaN is outside.
    TVSGS_HD bool in_box(Vec3f p) const {
        if (!has_box) return true;
        for (int axis = 0; axis < 3; ++axis)
            if (!(p[axis] >= box_min[axis] && p[axis] <= box_max[axis])) return false;
        return true;
    }
};

/// The first rule that drops a pixel.
enum class DepthOutcome : std::uint8_t {
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

/// Number of pixels by outcome.
struct DepthCounts {
    std::array<std::int64_t, 9> of{};
    std::int64_t operator[](DepthOutcome o) const { return of[static_cast<std::size_t>(o)]; }
};

/// The depth map of a view, ready for fusion.
template <class Device>
struct CleanDepth {
    Buffer<float, Device> depth;            // [H W] 0: dropped
    Buffer<float, Device> weight;           // [H W]; empty: 1
    Buffer<DepthOutcome, Device> outcomes;  // [H W]
};

/// Applies the rules to a rendered depth map; `clean` is resized and overwritten. `mask` ([H W],
/// 255 = object) may be empty.
template <class Device>
DepthCounts clean_depth(const RenderedImages<Device>& rendered,
                        const Camera& camera,
                        Span<const std::uint8_t> mask,
                        const DepthRules& rules,
                        CleanDepth<Device>& clean);

}  // namespace tvsgs
