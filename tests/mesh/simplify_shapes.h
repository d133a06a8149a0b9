// Surfaces and cameras for the tests of simplification, and counts of their topology.
#pragma once

#include <algorithm>
#include <map>
#include <random>
#include <set>
#include <tuple>
#include <utility>

#include "core/scene/camera.h"
#include "mesh/shapes.h"

namespace tvsgs::test {

/// Merges vertices of one position.
inline TriangleMesh weld(const TriangleMesh& mesh) {
    TriangleMesh out;
    std::map<std::tuple<float, float, float>, int> places;
    std::vector<int> renumbered;
    for (const Vec3f p : mesh.vertices) {
        const auto [at, fresh] =
            places.try_emplace({p.x, p.y, p.z}, static_cast<int>(out.vertices.size()));
        if (fresh) out.vertices.push_back(p);
        renumbered.push_back(at->second);
    }
    for (const Vec3i f : mesh.faces)
        out.faces.push_back({renumbered[std::size_t(f.x)], renumbered[std::size_t(f.y)],
                             renumbered[std::size_t(f.z)]});
    return out;
}

/// n x n pairs of triangles with opposite sides joined.
inline TriangleMesh torus(double major, double minor, int n) {
    TriangleMesh mesh;
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            const double u = 2 * M_PI * i / n, v = 2 * M_PI * j / n,
                         r = major + minor * std::cos(v);
            mesh.vertices.push_back(
                vec_cast<float>(Vec3d{r * std::cos(u), r * std::sin(u), minor * std::sin(v)}));
            const int right = (i + 1) % n, up = (j + 1) % n;
            mesh.faces.push_back({j * n + i, j * n + right, up * n + right});
            mesh.faces.push_back({j * n + i, up * n + right, up * n + i});
        }
    return mesh;
}

/// The square [0, side]^2 as n x n pairs of triangles, with heights and colours by position.
inline TriangleMesh relief(double side,
                           int n,
                           const std::function<double(double, double)>& height) {
    TriangleMesh mesh;
    add_patch(mesh, n, [&](double u, double v) {
        return Vec3d{side * u, side * v, height(side * u, side * v)};
    });
    return mesh;
}

struct Topology {
    int euler = 0;           // used vertices - edges + faces
    int boundary_edges = 0;  // of one face
    int crowded_edges = 0;   // of more than two faces
    int twisted_edges = 0;   // with two faces in the same direction
    int repeated_faces = 0;
    int pinched = 0;  // vertices that boundaries pass more than once
};

inline Topology topology(const TriangleMesh& mesh) {
    // Numbers of faces: forwards, backwards.
    std::map<std::pair<int, int>, std::pair<int, int>> edges;
    std::set<int> used;
    std::set<std::tuple<int, int, int>> faces;
    Topology out;
    for (const Vec3i f : mesh.faces) {
        int sorted[3] = {f.x, f.y, f.z};
        std::sort(sorted, sorted + 3);
        out.repeated_faces += !faces.insert({sorted[0], sorted[1], sorted[2]}).second;
        for (int k = 0; k < 3; ++k) {
            const int a = f[k], b = f[(k + 1) % 3];
            used.insert(a);
            auto& [forwards, backwards] = edges[{std::min(a, b), std::max(a, b)}];
            ++(a < b ? forwards : backwards);
        }
    }
    std::map<int, int> boundary_at;
    for (const auto& [edge, count] : edges) {
        const int all = count.first + count.second;
        if (all == 1) ++boundary_at[edge.first], ++boundary_at[edge.second];
        out.boundary_edges += all == 1;
        out.crowded_edges += all > 2;
        out.twisted_edges += count.first > 1 || count.second > 1;
    }
    for (const auto& [vertex, count] : boundary_at) out.pinched += count > 2;
    out.euler = static_cast<int>(used.size()) - static_cast<int>(edges.size()) +
                static_cast<int>(mesh.faces.size());
    return out;
}

/// ViewCounts from `eye` at `target`, in 400x400 pixels.
inline Camera looking(Vec3d eye, Vec3d target, double focal_px) {
    const Vec3d z = normalize(target - eye);
    const Vec3d x = normalize(cross(z, std::abs(z.z) < 0.9 ? Vec3d{0, 0, 1} : Vec3d{0, 1, 0}));
    const Vec3d y = cross(z, x);
    Camera camera{400, 400, float(focal_px), float(focal_px), 200, 200, {}};
    const Vec3d rows[3] = {x, y, z};
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) camera.camera_from_world.R[i][k] = float(rows[i][k]);
        camera.camera_from_world.t[i] = float(-dot(rows[i], eye));
    }
    return camera;
}

/// Six cameras around the origin.
inline std::vector<Camera> all_around(double distance, double focal_px) {
    std::vector<Camera> cameras;
    for (int axis = 0; axis < 3; ++axis)
        for (const double side : {-distance, distance}) {
            Vec3d eye{};
            eye[axis] = side;
            cameras.push_back(looking(eye, {0, 0, 0}, focal_px));
        }
    return cameras;
}

/// Independent samples of the standard normal distribution.
inline std::function<double()> noise(unsigned seed) {
    return [engine = std::mt19937(seed)]() mutable {
        double sum = -6;  // of twelve uniform numbers
        for (int i = 0; i < 12; ++i) sum += double(engine()) / 4294967296.0;
        return sum;
    };
}

}  // namespace tvsgs::test
