#include "mesh/fuse/depth_views.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/math/quantile.h"

namespace tvsgs {

double median_depth(std::vector<float> depths) {
    std::erase_if(depths, [](float d) { return !(d > 0 && std::isfinite(d)); });
    return depths.empty() ? 0 : static_cast<double>(middle_of(depths));
}

std::string limit_text(const DepthRules& rules) {
    return rules.depth_max < std::numeric_limits<float>::max()
               ? fmt::format("{:.4g}", rules.depth_max)
               : "any";
}

namespace {

/// "12 without a surface, 3 outside of the masks": the dropped pixels by reason.
std::string dropped_pixels(const DepthCounts& counts, const DepthRules& rules) {
    const std::string reasons[] = {"fused",
                                   "not finite",
                                   "without a surface",
                                   str("at depth ", rules.depth_max, " or more"),
                                   str("with coverage below ", rules.alpha_min),
                                   "outside of the masks",
                                   "at too flat an angle",
                                   "outside of --bbox",
                                   str("at ", rules.reach, " units or more from the object")};
    std::string text;
    for (std::size_t k = 1; k < counts.of.size(); ++k)
        if (counts.of[k] > 0)
            text += str(text.empty() ? "" : ", ", grouped(counts.of[k]), " ", reasons[k]);
    return text;
}

}  // namespace

namespace detail {

std::string why_none_passed(const DepthCounts& counts,
                            const DepthRules& rules,
                            double median_depth) {
    const std::string dropped = dropped_pixels(counts, rules);
    spdlog::debug("Depth pixels: {} fused{}", grouped(counts[DepthOutcome::kept]),
                  dropped.empty() ? "" : "; dropped: " + dropped);
    if (counts[DepthOutcome::kept] > 0) return {};
    return fmt::format(
        "all depth pixels were dropped: {} (the median depth of the last view is {:.4g}); raise "
        "--depth-max, lower --alpha-min, pass --everything, or check the masks (--no-masks) and "
        "--bbox",
        dropped, median_depth);
}

}  // namespace detail
}  // namespace tvsgs
