// Meshes of simple solids with a given subdivision.
#pragma once

#include <cmath>
#include <functional>

#include "core/scene/mesh.h"

namespace tvsgs::test {

/// A square of n x n pairs of triangles; place(u, v) for u, v in [0, 1].
inline void add_patch(TriangleMesh& mesh,
                      int n,
                      const std::function<Vec3d(double, double)>& place) {
    const int first = static_cast<int>(mesh.vertices.size());
    for (int j = 0; j <= n; ++j)
        for (int i = 0; i <= n; ++i)
            mesh.vertices.push_back(vec_cast<float>(place(double(i) / n, double(j) / n)));
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            const int a = first + j * (n + 1) + i, b = a + 1, c = a + n + 1, d = c + 1;
            mesh.faces.push_back({a, b, d});
            mesh.faces.push_back({a, d, c});
        }
}

/// The six sides of a box, 12 n^2 triangles, with its axes rotated by `turn`.
inline TriangleMesh box(Vec3d lower, Vec3d upper, int n, const Mat3<double>& turn) {
    TriangleMesh mesh;
    for (int axis = 0; axis < 3; ++axis)
        for (const bool high : {false, true})
            add_patch(mesh, n, [&](double u, double v) {
                Vec3d p;
                p[axis] = high ? upper[axis] : lower[axis];
                const int first = (axis + 1) % 3, second = (axis + 2) % 3;
                p[first] = lower[first] + (high ? u : v) * (upper[first] - lower[first]);
                p[second] = lower[second] + (high ? v : u) * (upper[second] - lower[second]);
                return turn * p;
            });
    return mesh;
}
inline TriangleMesh box(Vec3d lower, Vec3d upper, int n = 1) {
    return box(lower, upper, n, {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}});
}

inline TriangleMesh ball(Vec3d centre, double radius, int n) {
    TriangleMesh mesh = box({-1, -1, -1}, {1, 1, 1}, n);
    for (Vec3f& p : mesh.vertices)
        p = vec_cast<float>(centre + radius * normalize(vec_cast<double>(p)));
    return mesh;
}

/// A horizontal square with the given corner and side.
inline TriangleMesh square(Vec3d corner, double side, int n = 1) {
    TriangleMesh mesh;
    add_patch(mesh, n, [&](double u, double v) { return corner + Vec3d{side * u, side * v, 0}; });
    return mesh;
}

inline void append(TriangleMesh& mesh, const TriangleMesh& more) {
    const int first = static_cast<int>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), more.vertices.begin(), more.vertices.end());
    for (const Vec3i f : more.faces) mesh.faces.push_back({f.x + first, f.y + first, f.z + first});
}

inline double area(const TriangleMesh& mesh) {
    double sum = 0;
    for (const Vec3i f : mesh.faces) {
        const Vec3d a = vec_cast<double>(mesh.vertices[std::size_t(f.x)]),
                    b = vec_cast<double>(mesh.vertices[std::size_t(f.y)]),
                    c = vec_cast<double>(mesh.vertices[std::size_t(f.z)]);
        sum += 0.5 * norm(cross(b - a, c - a));
    }
    return sum;
}

/// Rotation by 0.4 rad about the axis (1, 2, 3).
inline Mat3<double> a_turn() {
    const Vec3d axis = normalize(Vec3d{1, 2, 3});
    const double s = std::sin(0.2);
    return rotation(Quat<double>{std::cos(0.2), s * axis.x, s * axis.y, s * axis.z});
}

}  // namespace tvsgs::test
