#include "mesh/fuse/depth_views.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/error.h"

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

namespace detail {

void log_pixel_counts(const DepthCounts& counts,
                      const DepthRules& rules,
                      spdlog::level::level_enum level) {
    const auto line = [&](const char* what, std::int64_t count) {
        if (count > 0) spdlog::log(level, "  {:>12} pixels dropped: {}", count, what);
    };
    spdlog::log(level, "  {:>12} pixels fused", counts.kept);
    line("depth not finite", counts.not_finite);
    line("no surface", counts.no_surface);
    line(str("depth at or beyond ", rules.depth_max).c_str(), counts.too_far);
    line(str("coverage below ", rules.alpha_min).c_str(), counts.transparent);
    line("outside of the mask", counts.masked);
    line("seen at too flat an angle", counts.grazing);
    line("outside of --bbox", counts.outside);
    line(str("at or beyond ", rules.reach, " from the middle").c_str(), counts.out_of_reach);
}

std::string why_none_passed(const DepthCounts& counts,
                            const DepthRules& rules,
                            double median_depth) {
    if (counts.kept > 0) return {};
    std::string dropped;
    const auto count = [&](const char* what, std::int64_t pixels) {
        if (pixels > 0) dropped += str(dropped.empty() ? "" : ", ", pixels, " ", what);
    };
    count("not finite", counts.not_finite);
    count("without a surface", counts.no_surface);
    count("too far", counts.too_far);
    count("of too little coverage", counts.transparent);
    count("outside of the masks", counts.masked);
    count("seen at too flat an angle", counts.grazing);
    count("outside of --bbox", counts.outside);
    count("too far from the middle", counts.out_of_reach);
    return fmt::format(
        "none of the depth pixels passed: {} (depths below {} pass; the median depth of the last "
        "view is {:.4g}); raise --depth-max, lower --alpha-min, or look at the masks (--no-masks) "
        "and --bbox",
        dropped, limit_text(rules), median_depth);
}

}  // namespace detail
}  // namespace tvsgs
