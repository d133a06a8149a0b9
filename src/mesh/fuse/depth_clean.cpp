#include "mesh/fuse/depth_clean_body.h"

namespace tvsgs {

DepthCounts clean_depth(const RenderedImages<Cpu>& rendered,
                        const Camera& camera,
                        Span<const std::uint8_t> mask,
                        const DepthRules& rules,
                        CleanDepth<Cpu>& clean) {
    return clean_depth_on(rendered, camera, mask, rules, clean);
}

DepthCounts count_fates(const std::vector<std::uint8_t>& fates) {
    DepthCounts counts;
    for (const std::uint8_t fate : fates) switch (static_cast<DepthFate>(fate)) {
            case DepthFate::kept:
                ++counts.kept;
                break;
            case DepthFate::not_finite:
                ++counts.not_finite;
                break;
            case DepthFate::no_surface:
                ++counts.no_surface;
                break;
            case DepthFate::too_far:
                ++counts.too_far;
                break;
            case DepthFate::transparent:
                ++counts.transparent;
                break;
            case DepthFate::masked:
                ++counts.masked;
                break;
            case DepthFate::grazing:
                ++counts.grazing;
                break;
            case DepthFate::outside:
                ++counts.outside;
                break;
            case DepthFate::out_of_reach:
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
