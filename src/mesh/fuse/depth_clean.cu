#include "mesh/fuse/depth_clean_body.h"

namespace tvsgs {

DepthCounts clean_depth(const RenderedImages<Cuda>& rendered,
                        const Camera& camera,
                        Span<const std::uint8_t> mask,
                        const DepthRules& rules,
                        CleanDepth<Cuda>& clean) {
    return clean_depth_on(rendered, camera, mask, rules, clean);
}

}  // namespace tvsgs
