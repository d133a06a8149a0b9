#include "mesh/simplify_tolerance.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/parallel.h"
#include "mesh/mesh_render.h"

namespace tvsgs {
namespace {

constexpr float kBehindPx = 1;  // that far behind the surface a vertex still belongs to it

/// The farthest of the four pixel centres around (u, v); infinite where one shows no surface.
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

std::vector<float> pixel_lengths(const TriangleMesh& mesh, const std::vector<Camera>& cameras) {
    constexpr float kNone = std::numeric_limits<float>::infinity();
    const int count = static_cast<int>(mesh.vertices.size());
    std::vector<float> seen(mesh.vertices.size(), kNone), in_image = seen, nearest = seen;
    for (const Camera& camera : cameras) {
        const ImageF depth = render_depth(mesh, camera);
        const Vec3f centre = camera_centre(camera);
        const float focal_px = std::max(camera.fx_px, camera.fy_px);
        parallel_for(Cpu{}, count, [&](int i) {
            const auto v = static_cast<std::size_t>(i);
            const auto shorten = [](float& length, float to) { length = std::min(length, to); };
            shorten(nearest[v], norm(mesh.vertices[v] - centre) / focal_px);
            if (!is_in_view(camera, mesh.vertices[v])) return;
            const Vec3f p = camera.camera_from_world * mesh.vertices[v];
            const float length = p.z / focal_px;
            shorten(in_image[v], length);
            const float surface = farthest_around(depth, camera.fx_px * p.x / p.z + camera.cx_px,
                                                  camera.fy_px * p.y / p.z + camera.cy_px);
            if (p.z <= surface + kBehindPx * length) shorten(seen[v], length);
        });
    }
    parallel_for(Cpu{}, count, [&](int i) {
        const auto v = static_cast<std::size_t>(i);
        if (seen[v] < kNone) return;
        seen[v] = kUnseenPixels * (in_image[v] < kNone ? in_image[v] : nearest[v]);
    });
    return seen;
}

}  // namespace tvsgs
