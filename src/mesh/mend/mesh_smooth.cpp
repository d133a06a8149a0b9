#include "core/device/parallel_lists.h"
#include "mesh/fuse/depth_view.h"
#include "mesh/mend/mend.h"
#include "mesh/mend/mesh_corners.h"

namespace tvsgs {
namespace {

constexpr int kNormalRounds = 5, kVertexRounds = 5;
constexpr double kMinCosine = 0.5;  // between normals of faces of one smooth part

template <class Body>
void for_each(std::size_t count, const Body& body) {
    parallel_for(Cpu{}, static_cast<int>(count), [&](int i) { body(static_cast<std::size_t>(i)); });
}

Vec3d normal_of(const std::vector<Vec3d>& points, Vec3i face) {
    const Vec3d a = points[face.x];
    // Length: twice the area.
    return cross(points[face.y] - a, points[face.z] - a);
}

Vec3d unit(Vec3d n) {
    const double length = norm(n);
    return length > 0 ? n / length : Vec3d{};
}

struct Planes {
    std::vector<Vec3d> normals;  // of faces, unit, or 0
    std::vector<double> areas;   // twice the area; 0 where the normal is 0
};

/// Averages normals over the adjacent faces with similar normals.
Planes averaged_planes(const TriangleMesh& mesh,
                       const Corners& corners,
                       const std::vector<Vec3d>& points) {
    const std::size_t faces = mesh.faces.size();
    Planes planes{std::vector<Vec3d>(faces), std::vector<double>(faces)};
    for_each(faces, [&](std::size_t f) {
        const Vec3d n = normal_of(points, mesh.faces[f]);
        if (is_finite(n)) planes.normals[f] = unit(n), planes.areas[f] = norm(n);
    });
    std::vector<Vec3d> next(faces);
    for (int round = 0; round < kNormalRounds; ++round) {
        for_each(faces, [&](std::size_t f) {
            Vec3d sum;
            for (int k = 0; k < 3; ++k)
                corners.for_each(mesh.faces[f][k], [&](std::uint32_t g, int) {
                    const double like = dot(planes.normals[f], planes.normals[g]) - kMinCosine;
                    if (like > 0) sum += (like * like * planes.areas[g]) * planes.normals[g];
                });
            next[f] = unit(sum);
        });
        std::swap(planes.normals, next);
    }
    return planes;
}

/// Greatest displacement of each vertex, world units.
std::vector<double> limits_of(const TriangleMesh& mesh,
                              const Corners& corners,
                              const std::vector<Camera>& cameras,
                              float limit_px) {
    const SurfaceEdges edges = find_edges(mesh, corners);
    std::vector<double> limits(mesh.vertices.size());
    for_each(limits.size(), [&](std::size_t v) {
        bool stays = edges.fixed[v] != 0;
        corners.for_each(static_cast<int>(v), [&](std::uint32_t f, int k) {
            for (const int edge : {k, (k + 2) % 3})
                stays = stays || edges.boundary[3 * f + std::size_t(edge)];
        });
        if (!stays) limits[v] = double(limit_px * pixel_length(cameras, mesh.vertices[v]));
    });
    return limits;
}

/// Moves vertices back until no face is flipped.
void unfold(const TriangleMesh& mesh,
            const Corners& corners,
            const std::vector<Vec3d>& before,
            std::vector<Vec3d>& after) {
    const auto moved = [&](int v) { return norm(after[v] - before[v]) > 0; };
    const auto is_wrong = [&](std::size_t f) {
        const Vec3i face = mesh.faces[f];
        return (moved(face.x) || moved(face.y) || moved(face.z)) &&
               !(dot(normal_of(before, face), normal_of(after, face)) > 0);
    };
    std::vector<int> waiting = indices_where(mesh.faces.size(), is_wrong);
    while (!waiting.empty()) {
        const auto f = static_cast<std::size_t>(waiting.back());
        waiting.pop_back();
        if (!is_wrong(f)) continue;
        for (int k = 0; k < 3; ++k) {
            const int v = mesh.faces[f][k];
            if (!moved(v)) continue;
            after[v] = before[v];
            corners.for_each(v,
                             [&](std::uint32_t g, int) { waiting.push_back(static_cast<int>(g)); });
        }
    }
}

}  // namespace

std::size_t smooth_surface(TriangleMesh& mesh, const std::vector<Camera>& cameras, float limit_px) {
    if (!(limit_px > 0)) return 0;
    const Corners corners(mesh);
    const std::vector<double> limits = limits_of(mesh, corners, cameras, limit_px);
    std::vector<Vec3d> before(mesh.vertices.size());
    for_each(before.size(), [&](std::size_t v) { before[v] = vec_cast<double>(mesh.vertices[v]); });
    const Planes planes = averaged_planes(mesh, corners, before);
    std::vector<Vec3d> now = before, next = before;
    for (int round = 0; round < kVertexRounds; ++round) {
        for_each(now.size(), [&](std::size_t v) {
            if (!(limits[v] > 0)) return;
            Vec3d sum, upright;
            double weight = 0;
            corners.for_each(static_cast<int>(v), [&](std::uint32_t f, int) {
                const Vec3i face = mesh.faces[f];
                const Vec3d n = planes.normals[f];
                const double area = planes.areas[f];
                if (!(area > 0)) return;
                const Vec3d off =
                    1.0 / 3 * (now[face.x] + now[face.y] + now[face.z] - 3.0 * now[v]);
                sum += area * dot(n, off) * n, upright += area * n, weight += area;
            });
            if (!(weight > 0)) return;
            const Vec3d n = unit(upright);
            const Vec3d way = now[v] - before[v] + dot(sum, n) / weight * n;
            const double length = norm(way);
            next[v] = before[v] + (length > limits[v] ? limits[v] / length : 1) * way;
        });
        std::swap(now, next);
    }
    for_each(now.size(), [&](std::size_t v) {  // rounded, as the check below sees it
        now[v] = vec_cast<double>(vec_cast<float>(now[v]));
    });
    unfold(mesh, corners, before, now);
    const auto moves = [&](std::size_t v) { return norm(now[v] - before[v]) > 0; };
    const std::size_t moved = indices_where(now.size(), moves).size();
    for_each(now.size(), [&](std::size_t v) { mesh.vertices[v] = vec_cast<float>(now[v]); });
    return moved;
}

}  // namespace tvsgs
