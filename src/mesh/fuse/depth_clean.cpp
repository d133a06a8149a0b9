#include "mesh/fuse/depth_clean_body.h"

namespace tvsgs {

DepthCounts clean_depth(const RenderedImages<Cpu>& rendered,
                        const Camera& camera,
                        Span<const std::uint8_t> mask,
                        const DepthRules& rules,
                        CleanDepth<Cpu>& clean) {
    return clean_depth_on(rendered, camera, mask, rules, clean);
}

DepthCounts count_outcomes(const std::vector<std::uint8_t>& outcomes) {
    DepthCounts counts;
    for (const std::uint8_t outcome : outcomes) switch (static_cast<DepthOutcome>(outcome)) {
            case DepthOutcome::kept:
                ++counts.kept;
                break;
            case DepthOutcome::not_finite:
                ++counts.not_finite;
                break;
            case DepthOutcome::no_surface:
                ++counts.no_surface;
                break;
            case DepthOutcome::too_far:
                ++counts.too_far;
                break;
            case DepthOutcome::transparent:
                ++counts.transparent;
                break;
            case DepthOutcome::masked:
                ++counts.masked;
                break;
            case DepthOutcome::grazing:
                ++counts.grazing;
                break;
            case DepthOutcome::outside:
                ++counts.outside;
                break;
            case DepthOutcome::out_of_reach:
                ++counts.out_of_reach;
                break;
        }
    return counts;
}

DepthCounts& operator+=(DepthCounts& a, const DepthCounts& b) {
    a.kept += b.kept, a.not_finite += b.not_finite, a.no_surface += b.no_surface,
        a.too_far += b.too_far;
    a.transparent += b.transparent, a.masked += b.masked, a.grazing += b.grazing,
        a.outside += b.outside, a.out_of_reach += b.out_of_reach;
    return a;
}

}  // namespace tvsgs
