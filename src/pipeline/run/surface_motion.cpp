#include "pipeline/run/surface_motion.h"

#include <cmath>

#include "core/math/quantile.h"

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
    const auto median = static_cast<double>(quantile(moved, 0.5));
    return {median, static_cast<double>(quantile(moved, 0.9)), moved.size()};
}

}  // namespace tvsgs
