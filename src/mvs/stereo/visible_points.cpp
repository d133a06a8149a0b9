#include "mvs/stereo/visible_points.h"

#include <algorithm>
#include <limits>

namespace tvsgs {

std::vector<VisiblePoint> visible_points(const Camera& camera, const std::vector<Vec3f>& points) {
    constexpr double kPerCell = 8, kBehind = 1.05, kSmallestCell = 2;
    std::vector<VisiblePoint> seen;
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (!is_in_view(camera, points[i])) continue;
        const Vec3d p = vec_cast<double>(camera.camera_from_world * points[i]);
        const double x = static_cast<double>(camera.fx_px) * p.x / p.z +
                         static_cast<double>(camera.cx_px),
                     y = static_cast<double>(camera.fy_px) * p.y / p.z +
                         static_cast<double>(camera.cy_px);
        seen.push_back({static_cast<int>(i), x, y, p.z, norm(p)});
    }
    const double pixels = static_cast<double>(camera.width_px) * camera.height_px;
    const double side = std::max(
        kSmallestCell, std::sqrt(kPerCell * pixels / static_cast<double>(seen.size() + 1)));
    const auto columns = static_cast<std::size_t>(camera.width_px / side) + 1,
               rows = static_cast<std::size_t>(camera.height_px / side) + 1;
    std::vector<double> nearest(columns * rows, std::numeric_limits<double>::infinity());
    const auto cell = [&](const VisiblePoint& p) -> double& {
        const auto column = std::min(static_cast<std::size_t>(p.x_px / side), columns - 1),
                   row = std::min(static_cast<std::size_t>(p.y_px / side), rows - 1);
        return nearest[row * columns + column];
    };
    for (const VisiblePoint& p : seen) cell(p) = std::min(cell(p), p.depth);
    std::erase_if(seen, [&](const VisiblePoint& p) { return p.depth > kBehind * cell(p); });
    return seen;
}

}  // namespace tvsgs
