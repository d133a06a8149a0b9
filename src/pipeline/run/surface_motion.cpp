#include "pipeline/run/surface_motion.h"

#include <cmath>

namespace tvsgs {

SurfaceMotion surface_motion(const std::vector<std::vector<float>>& before,
                             const std::vector<std::vector<float>>& after,
                             const std::vector<float>& focal_px) {
    std::vector<float> moved;
    for (std::size_t v = 0; v < before.size(); ++v)
        for (std::size_t i = 0; i < before[v].size(); ++i) {
            const float a = before[v][i], b = after[v][i];
            if (a > 0 && b > 0) moved.push_back(std::abs(a - b) * focal_px[v] / a);
        }
    if (moved.empty()) return {};
    const auto quantile = [&](double q) {
        const auto at =
            moved.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(moved.size() - 1));
        std::nth_element(moved.begin(), at, moved.end());
        return static_cast<double>(*at);
    };
    return {quantile(0.5), quantile(0.9), moved.size()};
}

}  // namespace tvsgs
