#include "mesh/fuse/depth_clean_body.h"

namespace tvsgs {
template DepthCounts clean_depth(const RenderedImages<Cpu>&,
                                 const Camera&,
                                 Span<const std::uint8_t>,
                                 const DepthRules&,
                                 CleanDepth<Cpu>&);
}  // namespace tvsgs
