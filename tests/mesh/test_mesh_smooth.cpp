// Smoothing removes roughness within its bound and keeps creases and boundaries.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "core/device/threads.h"
#include "mesh/mend/mend.h"
#include "mesh/shapes.h"
#include "mesh/simplify_shapes.h"

namespace tvsgs {
namespace {

using namespace test;

// A pixel at the origin is 0.02 wide.
const std::vector<Camera> kCameras = all_around(10, 500);
constexpr double kPixel = 0.02;

TriangleMesh roughened(TriangleMesh mesh, double deviation) {
    const auto off = noise(1);
    for (Vec3f& p : mesh.vertices)
        p += vec_cast<float>(Vec3d{deviation * off(), deviation * off(), deviation * off()});
    return mesh;
}

/// Root mean square of off(p) where it is finite.
template <class Off>
double roughness(const TriangleMesh& mesh, const Off& off) {
    double sum = 0, count = 0;
    for (const Vec3f p : mesh.vertices)
        if (const double d = off(vec_cast<double>(p)); std::isfinite(d)) sum += d * d, ++count;
    return std::sqrt(sum / count);
}

double longest_way(const TriangleMesh& a, const TriangleMesh& b) {
    double most = 0;
    for (std::size_t v = 0; v < a.vertices.size(); ++v)
        most = std::max(most, norm(vec_cast<double>(a.vertices[v] - b.vertices[v])));
    return most;
}

bool same_bytes(const TriangleMesh& a, const TriangleMesh& b) {
    return a.vertices.size() == b.vertices.size() &&
           std::memcmp(a.vertices.data(), b.vertices.data(), a.vertices.size() * sizeof(Vec3f)) ==
               0;
}

TEST(Smooth, TakesNoiseOffABall) {
    const TriangleMesh clean = weld(ball({}, 0.5, 20)), rough = roughened(clean, 0.2 * kPixel);
    const auto off = [](Vec3d p) { return norm(p) - 0.5; };
    ASSERT_NEAR(roughness(rough, off), 0.2 * kPixel, 0.02 * kPixel);
    for (const float limit_px : {0.05f, 1.0f}) {
        TriangleMesh mesh = rough;
        EXPECT_GT(smooth_surface(mesh, kCameras, limit_px), mesh.vertices.size() * 9 / 10);
        EXPECT_LE(longest_way(mesh, rough), 1.00001 * kPixel * double(limit_px));
        if (limit_px < 1) {
            EXPECT_GT(longest_way(mesh, rough), 0.9 * kPixel * double(limit_px));
            continue;
        }
        EXPECT_LT(roughness(mesh, off), 0.4 * roughness(rough, off));
        for (const Vec3i f : mesh.faces) {
            const auto normal = [&](const TriangleMesh& m) {
                const Vec3f a = m.vertices[std::size_t(f.x)];
                return cross(m.vertices[std::size_t(f.y)] - a, m.vertices[std::size_t(f.z)] - a);
            };
            EXPECT_GT(dot(normal(rough), normal(mesh)), 0);
        }
    }
    TriangleMesh kept = clean;
    smooth_surface(kept, kCameras, 1);
    EXPECT_LT(longest_way(kept, clean), 0.1 * kPixel) << "a clean ball does not shrink";
}

TEST(Smooth, KeepsBoundaries) {
    TriangleMesh sheet = square({-0.5, -0.5, 0}, 1, 40);
    const auto off = noise(2);
    for (Vec3f& p : sheet.vertices) p.z = float(0.2 * kPixel * off());
    std::swap(sheet.faces[0].y, sheet.faces[0].z);  // the opposite orientation
    TriangleMesh mesh = sheet;
    EXPECT_EQ(smooth_surface(mesh, kCameras, 1), 39u * 39u);
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        const std::size_t i = v % 41, j = v / 41;
        if (i % 40 != 0 && j % 40 != 0) continue;
        EXPECT_EQ(std::memcmp(&mesh.vertices[v], &sheet.vertices[v], sizeof(Vec3f)), 0);
    }
    const auto inner = [](Vec3d p) {
        return std::max(std::abs(p.x), std::abs(p.y)) < 0.4 ? p.z : double(NAN);
    };
    EXPECT_LT(roughness(mesh, inner), 0.4 * roughness(sheet, inner));
}

/// Distance to the surface of a cube of side 0.8 about the origin.
double off_cube(Vec3d p) {
    const Vec3d q{std::abs(p.x) - 0.4, std::abs(p.y) - 0.4, std::abs(p.z) - 0.4};
    const Vec3d out{std::max(q.x, 0.0), std::max(q.y, 0.0), std::max(q.z, 0.0)};
    return norm(out) + std::min(std::max({q.x, q.y, q.z}), 0.0);
}
bool at_edge(Vec3d p) {
    return (std::abs(p.x) > 0.385) + (std::abs(p.y) > 0.385) + (std::abs(p.z) > 0.385) > 1;
}

TEST(Smooth, LeavesCreases) {
    const TriangleMesh clean = weld(box({-0.4, -0.4, -0.4}, {0.4, 0.4, 0.4}, 32));
    TriangleMesh kept = clean;
    smooth_surface(kept, kCameras, 1);
    EXPECT_LT(longest_way(kept, clean), 1e-6);
    const TriangleMesh rough = roughened(clean, 0.1 * kPixel);
    TriangleMesh mesh = rough;
    smooth_surface(mesh, kCameras, 1);
    EXPECT_LT(roughness(mesh, off_cube), 0.6 * roughness(rough, off_cube));
    const auto edges = [](Vec3d p) { return at_edge(p) ? off_cube(p) : double(NAN); };
    EXPECT_LT(roughness(mesh, edges), 1.2 * roughness(rough, edges)) << "not rounded";
}

TEST(Smooth, LeavesEdgesOfFourFaces) {
    TriangleMesh boxes = box({-0.4, -0.4, -0.4}, {0, 0, 0.4}, 10);
    append(boxes, box({0, 0, -0.4}, {0.4, 0.4, 0.4}, 10));
    const TriangleMesh clean = weld(boxes), rough = roughened(clean, 0.1 * kPixel);
    TriangleMesh mesh = rough;
    EXPECT_GT(smooth_surface(mesh, kCameras, 1), mesh.vertices.size() / 2);
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
        if (clean.vertices[v].x == 0 && clean.vertices[v].y == 0) {
            EXPECT_EQ(std::memcmp(&mesh.vertices[v], &rough.vertices[v], sizeof(Vec3f)), 0);
        }
}

TEST(Smooth, KeepsARodsRadius) {
    // Six pixels thick, with edges of one pixel.
    const double radius = 3 * kPixel;
    TriangleMesh rod;
    add_patch(rod, 48, [&](double u, double v) {
        return Vec3d{radius * std::cos(2 * M_PI * u), radius * std::sin(2 * M_PI * u), v - 0.5};
    });
    for (Vec3f& p : rod.vertices)  // the seam, to be merged
        if (std::abs(p.y) < 1e-7f) p.y = 0;
    rod = weld(rod);
    const auto off = [&](Vec3d p) {
        return std::abs(p.z) < 0.4 ? std::hypot(p.x, p.y) - radius : double(NAN);
    };
    TriangleMesh mesh = roughened(rod, 0.1 * kPixel);
    const double before = roughness(mesh, off);
    smooth_surface(mesh, kCameras, 0.5);
    double sum = 0, count = 0;
    for (const Vec3f p : mesh.vertices)
        if (const double d = off(vec_cast<double>(p)); std::isfinite(d)) sum += d, ++count;
    EXPECT_NEAR(sum / count, 0, 0.1 * kPixel);
    EXPECT_LT(roughness(mesh, off), before);
}

TEST(Smooth, SameBytesForAnyNumberOfThreads) {
    const auto with_threads = [](int count) {
        const int threads = thread_count();
        set_thread_count(count);
        TriangleMesh mesh = roughened(weld(ball({}, 0.5, 20)), 0.5 * kPixel);
        smooth_surface(mesh, kCameras, 1);
        set_thread_count(threads);
        return mesh;
    };
    EXPECT_TRUE(same_bytes(with_threads(1), with_threads(2)));
}

TEST(Smooth, WhatIsNoSurfaceStays) {
    TriangleMesh empty;
    EXPECT_EQ(smooth_surface(empty, kCameras, 1), 0u);
    const TriangleMesh rough = roughened(weld(ball({}, 0.5, 10)), 0.2 * kPixel);
    TriangleMesh mesh = rough;
    EXPECT_EQ(smooth_surface(mesh, kCameras, 0), 0u);
    EXPECT_EQ(smooth_surface(mesh, {}, 1), 0u) << "no view, no pixel";
    EXPECT_TRUE(same_bytes(mesh, rough));
    // Isolated vertices, a repeated corner, three faces at an edge, NaN.
    TriangleMesh odd = rough;
    const int first = static_cast<int>(odd.vertices.size());
    odd.vertices.push_back({0.1f, 0.2f, 0.3f});
    odd.vertices.push_back({0.3f, 0.2f, 0.1f});
    odd.faces.push_back({odd.faces[7].x, odd.faces[7].y, first + 1});
    odd.faces.push_back({3, 3, 4});
    odd.vertices[20].x = std::numeric_limits<float>::quiet_NaN();
    odd.vertices[40].y = std::numeric_limits<float>::infinity();
    mesh = odd;
    EXPECT_GT(smooth_surface(mesh, kCameras, 1), mesh.vertices.size() / 2);
    for (const int v : {first, first + 1, odd.faces[7].x, odd.faces[7].y, 20, 40})
        EXPECT_EQ(std::memcmp(&mesh.vertices[std::size_t(v)], &odd.vertices[std::size_t(v)],
                              sizeof(Vec3f)),
                  0);
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        EXPECT_EQ(std::isfinite(mesh.vertices[v].x), v != 20);
    }
}

TEST(Smooth, NoFaceIsTurnedOver) {
    // Noise as large as the edges: many faces would flip.
    const TriangleMesh rough = roughened(weld(ball({}, 0.5, 30)), 0.6 * kPixel);
    TriangleMesh mesh = rough;
    EXPECT_GT(smooth_surface(mesh, kCameras, 2), 100u);
    EXPECT_LE(longest_way(mesh, rough), 2.00001 * kPixel);
    for (const Vec3i f : mesh.faces) {
        const auto normal = [&](const TriangleMesh& m) {
            const Vec3d a = vec_cast<double>(m.vertices[std::size_t(f.x)]);
            return cross(vec_cast<double>(m.vertices[std::size_t(f.y)]) - a,
                         vec_cast<double>(m.vertices[std::size_t(f.z)]) - a);
        };
        EXPECT_GT(dot(normal(rough), normal(mesh)), 0);
    }
}

}  // namespace
}  // namespace tvsgs
