// Rims are cut clean, and meshes are made sound before.
#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "core/error.h"
#include "mesh/evidence_scenes.h"
#include "mesh/mend_shapes.h"
#include "mesh/mesh_loops.h"
#include "mesh/mesh_rims.h"
#include "pipeline/mesh_extraction.h"

namespace tvsgs {
namespace {

using namespace test;

TEST(Sound, ASoundMeshStaysAsItIs) {
    const TriangleMesh before = welded(ball({0, 0, 0}, 1, 8));
    TriangleMesh mesh = before;
    const SoundReport report = make_sound(mesh);
    EXPECT_EQ(report.dropped_faces + report.split_vertices, 0u);
    ASSERT_EQ(mesh.faces.size(), before.faces.size());
    EXPECT_EQ(
        std::memcmp(mesh.faces.data(), before.faces.data(), mesh.faces.size() * sizeof(Vec3i)), 0);
    EXPECT_EQ(mesh.vertices.size(), before.vertices.size());
    TriangleMesh none;
    EXPECT_EQ(make_sound(none).dropped_faces, 0u);
}

TEST(Sound, SheetsThatShareAnEdgeGetTheirOwn) {
    // Three wings about the z axis, 4 x 4 squares each.
    TriangleMesh wings;
    for (int i = 0; i < 3; ++i)
        add_patch(wings, 4, [&](double u, double v) {
            return Vec3d{u * std::cos(2.1 * i), u * std::sin(2.1 * i), v};
        });
    wings = welded(wings);
    wings.colors.assign(wings.vertices.size(), {0.5f, 0.25f, 1});
    ASSERT_FALSE(topology(wings).sound);
    const double before = area(wings);
    const SoundReport report = make_sound(wings);
    EXPECT_EQ(report.dropped_faces, 0u);
    EXPECT_EQ(report.split_vertices, 10u);  // five on the axis, for two more wings
    EXPECT_TRUE(topology(wings).sound);
    EXPECT_EQ(topology(wings).euler, 3);
    ASSERT_EQ(wings.colors.size(), wings.vertices.size());
    for (const Vec3f c : wings.colors) EXPECT_EQ(c.y, 0.25f);
    EXPECT_DOUBLE_EQ(area(wings), before);
}

TEST(Sound, SheetsThatHangTogetherAtOneEndGetTheirOwn) {
    // Four faces at an edge, of which each end joins two and two, but not the same ones.
    TriangleMesh mesh{
        {{0, 0, 0}, {0, 0, 1}, {1, 0, 0.5f}, {0, 1, 0.5f}, {-1, 0, 0.5f}, {0, -1, 0.5f}},
        {},
        {{0, 1, 2}, {1, 0, 3}, {0, 1, 4}, {1, 0, 5}}};
    for (const Vec3i f : {Vec3i{0, 2, 3}, {0, 4, 5}, {1, 3, 4}, {1, 5, 2}}) mesh.faces.push_back(f);
    const std::size_t faces = mesh.faces.size();
    const SoundReport report = make_sound(mesh);
    EXPECT_EQ(report.split_vertices, 2u);
    EXPECT_EQ(mesh.faces.size(), faces);
    std::map<std::pair<int, int>, int> edges;
    for (const Vec3i f : mesh.faces)
        for (int k = 0; k < 3; ++k) ++edges[std::minmax(f[k], f[(k + 1) % 3])];
    for (const auto& [edge, count] : edges) EXPECT_LE(count, 2);
}

TEST(Sound, FacesWithoutAreaGo) {
    TriangleMesh mesh = sheet(0, 0, 0, 1, 4);
    const std::size_t faces = mesh.faces.size();
    const Topology before = topology(mesh);
    // A vertex in the place of another: the faces between them have no area, the others are joined.
    mesh.vertices[13] = mesh.vertices[12];
    // A face twice, turned round; a corner twice; a corner that is nowhere; three in a line.
    mesh.faces.push_back({mesh.faces[3].y, mesh.faces[3].x, mesh.faces[3].z});
    mesh.faces.push_back({0, 0, 1});
    mesh.vertices.push_back({0, std::numeric_limits<float>::quiet_NaN(), 0});
    mesh.faces.push_back({0, 1, 25});
    mesh.faces.push_back({0, 1, 2});
    const SoundReport report = make_sound(mesh);
    EXPECT_EQ(report.dropped_faces, 6u);
    EXPECT_EQ(mesh.faces.size(), faces - 2);
    const Topology after = topology(mesh);
    EXPECT_TRUE(after.sound);
    EXPECT_EQ(after.rim_edges, before.rim_edges);
    EXPECT_EQ(after.euler, before.euler);
    EXPECT_EQ(mesh.vertices.size(), 24u);
    mesh.faces.push_back({0, 1, 24});
    EXPECT_THROW(make_sound(mesh), Error);
}

/// A level sheet of squares 0.02 wide, of whose last row every second one is gone.
TriangleMesh battlement() {
    return without(sheet(0, 0, 0, 0.4, 20), [](Vec3f p) {
        return p.x > 0.18f && static_cast<int>(std::floor((p.y + 0.2f) / 0.02f)) % 2 == 0;
    });
}
/// One whose side at x = 0.2 is a saw.
TriangleMesh saw() {
    TriangleMesh mesh = sheet(0, 0, 0, 0.4, 20);
    for (std::size_t v = 20; v < mesh.vertices.size(); v += 42) mesh.vertices[v].x += 0.012f;
    return mesh;
}
const std::vector<Camera> kCameras{look_at_origin({0, 0.01, 5}, 200)};  // a pixel is 0.025 wide

TEST(Rims, LoseTheirTeeth) {
    // A row of triangles on a straight rim.
    TriangleMesh mesh = sheet(0, 0, 0, 0.4, 20);
    const std::size_t straight = mesh.faces.size();
    for (int i = 3; i < 17; i += 2) {
        const int a = 20 * 21 + i;
        mesh.vertices.push_back(mesh.vertices[std::size_t(a)] + Vec3f{0.01f, 0.02f, 0});
        mesh.faces.push_back({a, a + 1, static_cast<int>(mesh.vertices.size()) - 1});
    }
    TriangleMesh none = mesh;
    EXPECT_EQ(drop_teeth(none, 0), 0u);
    EXPECT_EQ(none.faces.size(), mesh.faces.size());
    // Two faces at corners of the sheet are teeth, too.
    EXPECT_EQ(drop_teeth(mesh, 1), 9u);
    EXPECT_EQ(mesh.faces.size(), straight - 2);
    EXPECT_TRUE(topology(mesh).sound);
    // What a round lays open goes with the next: a chain of faces, and a lone one at once.
    TriangleMesh chain = sheet(0, 0, 0, 0.4, 20);
    const int first = static_cast<int>(chain.vertices.size());
    for (int i = 0; i < 6; ++i)
        chain.vertices.push_back({0.01f * float(i), i % 2 == 0 ? 1.0f : 1.01f, 0});
    for (int i = 0; i + 2 < 6; ++i)
        chain.faces.push_back({first + i, first + i + 1 + i % 2, first + i + 2 - i % 2});
    const std::size_t whole = chain.faces.size();
    TriangleMesh once = chain, twice = chain;
    EXPECT_EQ(drop_teeth(once, 1), 4u);
    EXPECT_EQ(drop_teeth(twice, 2), 6u);
    EXPECT_EQ(twice.faces.size(), whole - 6);
    EXPECT_EQ(twice.vertices.size(), static_cast<std::size_t>(first) - 2);
}

/// Mean square distance of the sawn side, corners aside, from its straight middle.
double roughness(const TriangleMesh& mesh) {
    double sum = 0, mean = 0;
    std::vector<double> x;
    const Rims rims = find_rims(mesh);
    for (const int v : rims.vertices)
        if (const Vec3f p = mesh.vertices[std::size_t(v)]; p.x > 0.15f && std::abs(p.y) < 0.15f)
            x.push_back(static_cast<double>(p.x));
    for (const double v : x) mean += v / static_cast<double>(x.size());
    for (const double v : x) sum += (v - mean) * (v - mean) / static_cast<double>(x.size());
    return std::sqrt(sum);
}

TEST(Rims, BecomeSmoothWithinTheBound) {
    const TriangleMesh rough = saw();
    ASSERT_NEAR(roughness(rough), 0.006, 1e-4);
    for (const float limit_px : {0.1f, 1.0f}) {
        TriangleMesh mesh = rough;
        EXPECT_GT(smooth_rims(mesh, kCameras, limit_px), 40u);
        double most = 0;
        for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
            EXPECT_EQ(mesh.vertices[v].z, 0) << "not out of the plane";
            most = std::max(most, static_cast<double>(norm(mesh.vertices[v] - rough.vertices[v])));
        }
        EXPECT_LE(most, 0.02501 * static_cast<double>(limit_px));
        if (limit_px < 1)
            EXPECT_GT(most, 0.0249 * static_cast<double>(limit_px));
        else
            EXPECT_LT(roughness(mesh), 0.1 * roughness(rough));
        const Topology t = topology(mesh);
        EXPECT_TRUE(t.sound);
        for (const Vec3i f : mesh.faces) {
            const Vec3f a = mesh.vertices[std::size_t(f.x)];
            EXPECT_GT(
                cross(mesh.vertices[std::size_t(f.y)] - a, mesh.vertices[std::size_t(f.z)] - a).z,
                0);
        }
    }
    TriangleMesh still = rough;
    EXPECT_EQ(smooth_rims(still, kCameras, 0), 0u);
    EXPECT_EQ(smooth_rims(still, {}, 1), 0u) << "no view, no pixel";
    EXPECT_EQ(smooth_rims(still, {look_at_origin({0, 0.01, -5}, 200)}, 0.001f) > 0, true);
}

TEST(Rims, MoveWithinTheSurface) {
    TriangleMesh mesh = saw();
    for (std::size_t v = 0; v < mesh.vertices.size(); v += 3) mesh.vertices[v].z += 0.004f;
    const TriangleMesh before = mesh;
    const Rims rims = find_rims(before);
    EXPECT_GT(smooth_rims(mesh, kCameras, 1), 40u);
    double most = 0;
    for (std::size_t i = 0; i < rims.vertices.size(); ++i) {
        const auto v = static_cast<std::size_t>(rims.vertices[i]);
        const Vec3d off = vec_cast<double>(mesh.vertices[v] - before.vertices[v]);
        EXPECT_NEAR(dot(off, rims.normals[i]), 0, 1e-6);
        most = std::max(most, norm(off));
    }
    EXPECT_GT(most, 0.003);
}

TEST(Rims, OfMissingSquaresBecomeStraight) {
    TriangleMesh mesh = battlement();
    ASSERT_NEAR(roughness(mesh), 0.01, 1e-3);
    EXPECT_GT(drop_teeth(mesh, 3), 18u);
    smooth_rims(mesh, kCameras, 1);
    EXPECT_LT(roughness(mesh), 0.001);
    EXPECT_TRUE(topology(mesh).sound);
}

TEST(Rims, InnerVerticesAndPlacesWhereRimsTouchStay) {
    TriangleMesh mesh = without(sheet(0, 0, 0, 0.4, 20), [](Vec3f p) {
        const int i = static_cast<int>(std::floor((p.x + 0.2f) / 0.02f)),
                  j = static_cast<int>(std::floor((p.y + 0.2f) / 0.02f));
        return (i >= 5 && i < 8 && j >= 5 && j < 8) || (i >= 8 && i < 11 && j >= 8 && j < 11);
    });
    const TriangleMesh before = mesh;
    const Rims rims = find_rims(mesh);
    EXPECT_EQ(rims.loops.size(), 3u);
    smooth_rims(mesh, kCameras, 1);
    std::size_t touching = 0;
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        const int place = rims.place(static_cast<int>(v));
        const bool touches = place >= 0 && rims.rim_edges[std::size_t(place)] == 4;
        touching += touches;
        if (place < 0 || touches) {
            EXPECT_EQ(std::memcmp(&mesh.vertices[v], &before.vertices[v], sizeof(Vec3f)), 0);
        }
    }
    EXPECT_EQ(touching, 1u);
}

TEST(Rims, NoFaceIsTurnedOver) {
    // A bound of many pixels would pull this ragged rim through the row of faces behind it.
    TriangleMesh mesh = battlement();
    for (Vec3f& p : mesh.vertices) {
        if (p.x > 0.15f && p.x < 0.19f) p.x = 0.179f + 0.1f * (p.x - 0.16f);
        if (p.x > 0.19f) p.x += 0.1f;
    }
    const TriangleMesh before = mesh;
    smooth_rims(mesh, kCameras, 100);
    EXPECT_TRUE(topology(mesh).sound);
    for (const Vec3i f : mesh.faces) {
        const auto twice = [&](const TriangleMesh& m) {
            const Vec3f a = m.vertices[std::size_t(f.x)];
            return cross(m.vertices[std::size_t(f.y)] - a, m.vertices[std::size_t(f.z)] - a).z;
        };
        EXPECT_GE(twice(mesh), 0.099f * twice(before));
    }
}

TEST(Mending, IsTheOptionsChoice) {
    const TriangleMesh scene = without(saw(), [](Vec3f p) { return norm(p) < 0.03f; });
    const std::vector<EvidenceView> views = views_of(saw());
    const auto mended = [&](float holes, float rims) {
        TriangleMesh mesh = scene;
        MeshOptions options;
        options.holes = holes, options.rims = rims, options.smooth = 0;
        detail::mend_mesh(mesh, kCameras, options, source_of(views), spdlog::level::debug);
        return mesh;
    };
    const TriangleMesh none = mended(0, 0), both = mended(10, 1);
    EXPECT_EQ(none.faces.size(), scene.faces.size());
    EXPECT_EQ(std::memcmp(none.vertices.data(), scene.vertices.data(),
                          scene.vertices.size() * sizeof(Vec3f)),
              0);
    EXPECT_EQ(topology(scene).euler, 0);
    EXPECT_EQ(topology(mended(10, 0)).euler, 1);
    EXPECT_EQ(topology(mended(0, 1)).euler, 0);
    EXPECT_EQ(topology(both).euler, 1);
    EXPECT_LT(roughness(both), 0.5 * roughness(scene));
    EXPECT_EQ(roughness(mended(10, 0)), roughness(scene));
    TriangleMesh empty;
    EXPECT_EQ(detail::mend_mesh(empty, kCameras, {}, {}, spdlog::level::debug), "");
    TriangleMesh tooth;
    tooth.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, tooth.faces = {{0, 1, 2}};
    MeshOptions rims;
    rims.rims = 1, rims.holes = 0;
    const std::string why =
        detail::mend_mesh(tooth, kCameras, rims, source_of(views), spdlog::level::debug);
    EXPECT_TRUE(tooth.faces.empty());
    EXPECT_NE(why.find("mesh.rims=0"), std::string::npos) << why;
}

TEST(Mending, SmoothsUnlessClosedOrToldNotTo) {
    TriangleMesh rough = sheet(0, 0, 0, 0.4, 20);
    for (std::size_t v = 0; v < rough.vertices.size(); v += 3) rough.vertices[v].z += 0.004f;
    const auto moved = [&](float smooth, bool watertight) {
        TriangleMesh mesh = rough;
        MeshOptions options;
        options.holes = 0, options.smooth = smooth, options.watertight = watertight;
        detail::mend_mesh(mesh, kCameras, options, {}, spdlog::level::debug);
        EXPECT_EQ(mesh.faces.size(), rough.faces.size());
        std::size_t count = 0;
        for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
            count += mesh.vertices[v].z != rough.vertices[v].z;
        return count;
    };
    EXPECT_EQ(moved(MeshOptions{}.smooth, false), 19u * 19u);
    EXPECT_EQ(moved(0, false), 0u);
    EXPECT_EQ(moved(1, true), 0u);
}

TEST(Rims, SameBytesForAnyNumberOfThreads) {
    const auto with_threads = [&](int count) {
        const int threads = omp_get_max_threads();
        omp_set_num_threads(count);
        TriangleMesh mesh = saw();
        drop_teeth(mesh, 3);
        smooth_rims(mesh, kCameras, 1);
        omp_set_num_threads(threads);
        return mesh;
    };
    const TriangleMesh one = with_threads(1), four = with_threads(4);
    ASSERT_EQ(one.vertices.size(), four.vertices.size());
    EXPECT_EQ(
        std::memcmp(one.vertices.data(), four.vertices.data(), one.vertices.size() * sizeof(Vec3f)),
        0);
}

}  // namespace
}  // namespace tvsgs
