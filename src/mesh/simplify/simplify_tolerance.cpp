#include <algorithm>
#include <cmath>
#include <limits>

#include "core/device/parallel.h"
#include "mesh/draw/mesh_render.h"
#include "mesh/simplify/simplify_proof.h"

namespace tvsgs {
namespace {

constexpr float kBehindPx = 1;  // a vertex up to so far behind the depth map is visible

constexpr float kNone = std::numeric_limits<float>::infinity();
constexpr float kShortest = 1e-30f, kLongest = 1e30f;

/// Pixel length by distance, for the camera where it is least.
float nearest_pixel(Vec3f point, const std::vector<Camera>& cameras) {
    float nearest = kNone;
    for (const Camera& camera : cameras)
        nearest = std::min(
            nearest, norm(point - camera_centre(camera)) / std::max(camera.fx_px, camera.fy_px));
    return nearest;
}

/// The farthest of the four pixel centres around (u, v); infinite if one has no surface.
float farthest_around(const ImageF& depth, float u, float v) {
    float farthest = 0;
    for (const float du : {-0.5f, 0.5f})
        for (const float dv : {-0.5f, 0.5f}) {
            const int x = std::clamp(static_cast<int>(std::floor(u + du)), 0, depth.width - 1);
            const int y = std::clamp(static_cast<int>(std::floor(v + dv)), 0, depth.height - 1);
            const float d = depth.at(x, y);
            farthest = std::max(farthest, d > 0 ? d : std::numeric_limits<float>::infinity());
        }
    return farthest;
}

}  // namespace

std::vector<float> pixel_lengths(const TriangleMesh& mesh,
                                 const std::vector<Vec3f>& points,
                                 const std::vector<Camera>& cameras) {
    const int count = static_cast<int>(points.size());
    std::vector<float> seen(points.size(), kNone), in_image = seen;
    for (const Camera& camera : cameras) {
        const ImageF depth = render_depth(mesh, camera);
        const float focal_px = std::max(camera.fx_px, camera.fy_px);
        parallel_for(Cpu{}, count, [&](int i) {
            const auto v = static_cast<std::size_t>(i);
            const Vec3f p = camera.camera_from_world * points[v];
            const float length = p.z / focal_px;
            if (length >= seen[v] || !is_in_view(camera, points[v])) return;
            in_image[v] = std::min(in_image[v], length);
            const float surface = farthest_around(depth, camera.fx_px * p.x / p.z + camera.cx_px,
                                                  camera.fy_px * p.y / p.z + camera.cy_px);
            if (p.z <= surface + kBehindPx * length) seen[v] = length;
        });
    }
    parallel_for(Cpu{}, count, [&](int i) {
        const auto v = static_cast<std::size_t>(i);
        if (seen[v] == kNone)
            seen[v] = kUnseenPixels *
                      (in_image[v] < kNone ? in_image[v] : nearest_pixel(points[v], cameras));
        seen[v] = std::clamp(seen[v], kShortest, kLongest);
    });
    return seen;
}

std::vector<float> least_pixel_lengths(const std::vector<Vec3f>& points,
                                       const std::vector<Camera>& cameras) {
    std::vector<float> out(points.size());
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) {
        const Vec3f point = points[i];
        float least = kNone;
        for (const Camera& camera : cameras)
            if (is_in_view(camera, point))
                least = std::min(least, (camera.camera_from_world * point).z /
                                            std::max(camera.fx_px, camera.fy_px));
        if (least == kNone) least = kUnseenPixels * nearest_pixel(point, cameras);
        out[i] = std::clamp(least, kShortest, kLongest);
    });
    return out;
}

}  // namespace tvsgs
