#include "mesh/fuse/depth_views.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"

namespace tvsgs {

double median_depth(std::vector<float> depths) {
    std::erase_if(depths, [](float d) { return !(d > 0 && std::isfinite(d)); });
    if (depths.empty()) return 0;
    const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
    std::nth_element(depths.begin(), middle, depths.end());
    return static_cast<double>(*middle);
}

std::string limit_text(const DepthRules& rules) {
    return rules.depth_max < std::numeric_limits<float>::max()
               ? fmt::format("{:.4g}", rules.depth_max)
               : "any";
}

namespace {

/// "12 without a surface, 3 outside of the masks": the dropped pixels by reason.
std::string dropped_pixels(const DepthCounts& counts, const DepthRules& rules) {
    std::string text;
    const auto add = [&](std::int64_t pixels, const auto&... reason) {
        if (pixels > 0) text += str(text.empty() ? "" : ", ", grouped(pixels), " ", reason...);
    };
    add(counts.not_finite, "not finite");
    add(counts.no_surface, "without a surface");
    add(counts.too_far, "at depth ", rules.depth_max, " or more");
    add(counts.transparent, "with coverage below ", rules.alpha_min);
    add(counts.masked, "outside of the masks");
    add(counts.grazing, "at too flat an angle");
    add(counts.outside, "outside of --bbox");
    add(counts.out_of_reach, "at ", rules.reach, " units or more from the object");
    return text;
}

}  // namespace

namespace detail {

void log_pixel_counts(const DepthCounts& counts, const DepthRules& rules) {
    const std::string dropped = dropped_pixels(counts, rules);
    spdlog::debug("Depth pixels: {} fused{}", grouped(counts.kept),
                  dropped.empty() ? "" : "; dropped: " + dropped);
}

std::string why_none_passed(const DepthCounts& counts,
                            const DepthRules& rules,
                            double median_depth) {
    if (counts.kept > 0) return {};
    return fmt::format(
        "all depth pixels were dropped: {} (the median depth of the last view is {:.4g}); raise "
        "--depth-max, lower --alpha-min, or check the masks (--no-masks) and --bbox",
        dropped_pixels(counts, rules), median_depth);
}

}  // namespace detail
}  // namespace tvsgs
