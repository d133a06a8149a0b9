#include "mvs/stereo/planar_prior.h"

#include <algorithm>

#include "core/scene/scene.h"
#include "mvs/stereo/triangulation.h"

namespace tvsgs {
namespace {

constexpr int kCell = 5;               // px
constexpr float kSupportCost = 0.1f;   // largest cost of a support point
constexpr float kMaxSideShare = 0.2f;  // of the image's width

/// Support points along the rows of cells, alternating in direction.
std::vector<Vec2<int>> support_points(const Camera& camera,
                                      Span<const float> costs,
                                      const std::vector<std::uint8_t>& mask) {
    std::vector<Vec2<int>> out;
    const int columns = (camera.width_px + kCell - 1) / kCell;
    for (int row = 0; row * kCell < camera.height_px; ++row)
        for (int i = 0; i < columns; ++i) {
            const int column = row % 2 == 0 ? i : columns - 1 - i;
            float least = kSupportCost;
            Vec2<int> best{-1, -1};
            for (int y = row * kCell; y < std::min((row + 1) * kCell, camera.height_px); ++y)
                for (int x = column * kCell; x < std::min((column + 1) * kCell, camera.width_px);
                     ++x) {
                    const std::size_t at = static_cast<std::size_t>(y) * camera.width_px + x;
                    if (costs[at] < least && (mask.empty() || mask[at] >= kObjectMask))
                        least = costs[at], best = {x, y};
                }
            if (best.x >= 0) out.push_back(best);
        }
    return out;
}

int cross(Vec2<int> a, Vec2<int> b) {
    return a.x * b.y - a.y * b.x;
}

}  // namespace

std::vector<SurfacePlane> planar_prior(const Camera& camera,
                                       Span<const SurfacePlane> planes,
                                       Span<const float> costs,
                                       const std::vector<std::uint8_t>& mask) {
    std::vector<SurfacePlane> prior(planes.size(), SurfacePlane{{0, 0, -1}, 0});
    const std::vector<Vec2<int>> points = support_points(camera, costs, mask);
    const auto index = [&](Vec2<int> p) {
        return static_cast<std::size_t>(p.y) * camera.width_px + p.x;
    };
    const float longest = kMaxSideShare * static_cast<float>(camera.width_px);
    for (const auto& corners : delaunay(points)) {
        Vec2<int> pixel[3];
        Vec3f point[3];
        for (std::size_t k = 0; k < 3; ++k) {
            pixel[k] = points[corners[k]];
            point[k] = planes[index(pixel[k])].depth * pixel_ray(camera, pixel[k].x, pixel[k].y);
        }
        bool wide = false;
        for (int k = 0; k < 3; ++k) {
            const Vec2<int> side = pixel[(k + 1) % 3] - pixel[k];
            wide |= static_cast<float>(side.x * side.x + side.y * side.y) > longest * longest;
        }
        Vec3f normal = cross(point[1] - point[0], point[2] - point[0]);
        if (wide || !(norm(normal) > 0)) continue;
        normal = normalize(normal);
        if (dot(normal, point[0]) > 0) normal = -normal;

        const auto [left, right] = std::minmax({pixel[0].x, pixel[1].x, pixel[2].x});
        const auto [top, bottom] = std::minmax({pixel[0].y, pixel[1].y, pixel[2].y});
        for (int y = top; y <= bottom; ++y)
            for (int x = left; x <= right; ++x) {
                bool inside = true;
                for (int k = 0; k < 3; ++k)
                    inside &= cross(pixel[(k + 1) % 3] - pixel[k], Vec2<int>{x, y} - pixel[k]) >= 0;
                const Vec3f ray = pixel_ray(camera, x, y);
                const float slope = dot(normal, ray);
                if (!inside || !(slope < -kMinFacing)) continue;
                prior[index({x, y})] = {normal, dot(normal, point[0]) / slope};
            }
    }
    return prior;
}

}  // namespace tvsgs
