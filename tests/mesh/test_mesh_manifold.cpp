// Tests the repair of meshes before later steps.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <utility>

#include "core/error.h"
#include "mesh/evidence_scenes.h"
#include "mesh/mend_shapes.h"
#include "mesh/meshers_list.h"
#include "pipeline/mesh/mesh_extraction.h"

namespace tvsgs {
namespace {

using namespace test;

TEST(Sound, ASoundMeshStaysAsItIs) {
    const TriangleMesh before = welded(ball({0, 0, 0}, 1, 8));
    TriangleMesh mesh = before;
    const ManifoldReport report = make_manifold(mesh);
    EXPECT_EQ(report.dropped_faces + report.split_vertices, 0u);
    ASSERT_EQ(mesh.faces.size(), before.faces.size());
    EXPECT_EQ(
        std::memcmp(mesh.faces.data(), before.faces.data(), mesh.faces.size() * sizeof(Vec3i)), 0);
    EXPECT_EQ(mesh.vertices.size(), before.vertices.size());
    TriangleMesh none;
    EXPECT_EQ(make_manifold(none).dropped_faces, 0u);
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
    const ManifoldReport report = make_manifold(wings);
    EXPECT_EQ(report.dropped_faces, 0u);
    EXPECT_EQ(report.split_vertices, 10u);  // five on the axis, for each of the two other wings
    EXPECT_TRUE(topology(wings).sound);
    EXPECT_EQ(topology(wings).euler, 3);
    ASSERT_EQ(wings.colors.size(), wings.vertices.size());
    for (const Vec3f c : wings.colors) EXPECT_EQ(c.y, 0.25f);
    EXPECT_DOUBLE_EQ(area(wings), before);
}

TEST(Sound, SheetsThatHangTogetherAtOneEndGetTheirOwn) {
    // Four faces at an edge; each end of the edge connects them in pairs, but in different pairs.
    TriangleMesh mesh{
        {{0, 0, 0}, {0, 0, 1}, {1, 0, 0.5f}, {0, 1, 0.5f}, {-1, 0, 0.5f}, {0, -1, 0.5f}},
        {},
        {{0, 1, 2}, {1, 0, 3}, {0, 1, 4}, {1, 0, 5}}};
    for (const Vec3i f : {Vec3i{0, 2, 3}, {0, 4, 5}, {1, 3, 4}, {1, 5, 2}}) mesh.faces.push_back(f);
    const std::size_t faces = mesh.faces.size();
    const ManifoldReport report = make_manifold(mesh);
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
    // Two vertices at one position: the faces between them have no area, the others become
    // connected.
    mesh.vertices[13] = mesh.vertices[12];
    // A repeated face with reversed order; a repeated corner; a corner that is not finite; three
    // collinear corners.
    mesh.faces.push_back({mesh.faces[3].y, mesh.faces[3].x, mesh.faces[3].z});
    mesh.faces.push_back({0, 0, 1});
    mesh.vertices.push_back({0, std::numeric_limits<float>::quiet_NaN(), 0});
    mesh.faces.push_back({0, 1, 25});
    mesh.faces.push_back({0, 1, 2});
    const ManifoldReport report = make_manifold(mesh);
    EXPECT_EQ(report.dropped_faces, 6u);
    EXPECT_EQ(mesh.faces.size(), faces - 2);
    const Topology after = topology(mesh);
    EXPECT_TRUE(after.sound);
    EXPECT_EQ(after.boundary_edges, before.boundary_edges);
    EXPECT_EQ(after.euler, before.euler);
    EXPECT_EQ(mesh.vertices.size(), 24u);
    mesh.faces.push_back({0, 1, 24});
    EXPECT_THROW(make_manifold(mesh), Error);
}

const std::vector<Camera> kCameras{look_at_origin({0, 0.01, 5}, 200)};  // a pixel is 0.025 wide

TEST(Mending, IsTheOptionsChoice) {
    const TriangleMesh whole = sheet(0, 0, 0, 0.4, 20);
    const TriangleMesh scene = without(whole, [](Vec3f p) { return norm(p) < 0.03f; });
    const std::vector<EvidenceView> views = views_of(whole);
    const auto mended = [&](float holes) {
        TriangleMesh mesh = scene;
        MeshOptions options;
        options.holes = holes, options.smooth = 0;
        detail::mend_mesh(mesh, kCameras, options, source_of(views));
        return mesh;
    };
    const TriangleMesh none = mended(0);
    EXPECT_EQ(none.faces.size(), scene.faces.size());
    EXPECT_EQ(std::memcmp(none.vertices.data(), scene.vertices.data(),
                          scene.vertices.size() * sizeof(Vec3f)),
              0);
    EXPECT_EQ(topology(scene).euler, 0);
    EXPECT_EQ(topology(mended(10)).euler, 1);
    TriangleMesh empty;
    detail::mend_mesh(empty, kCameras, {}, {});
    EXPECT_TRUE(empty.faces.empty());
}

TEST(Mending, DependsOnTheMesher) {
    using Traits = std::map<std::string, std::pair<bool, bool>>;  // rough, closed
    Traits found;
    const MesherOptions options;
    for (const auto& [name, make] : all_meshers<Cpu>(options)) {
        const auto mesher = make();
        found[name] = {mesher->is_rough(), mesher->is_closed()};
    }
    EXPECT_EQ(found, (Traits{{"tsdf", {true, false}},
                             {"tetrahedra", {false, false}},
                             {"watertight", {false, true}}}));
}

TEST(Mending, SmoothsUnlessToldNotTo) {
    TriangleMesh rough = sheet(0, 0, 0, 0.4, 20);
    for (std::size_t v = 0; v < rough.vertices.size(); v += 3) rough.vertices[v].z += 0.004f;
    const auto moved = [&](float smooth) {
        TriangleMesh mesh = rough;
        MeshOptions options;
        options.holes = 0, options.smooth = smooth;
        detail::mend_mesh(mesh, kCameras, options, {});
        EXPECT_EQ(mesh.faces.size(), rough.faces.size());
        std::size_t count = 0;
        for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
            count += mesh.vertices[v].z != rough.vertices[v].z;
        return count;
    };
    EXPECT_EQ(moved(MeshOptions{}.smooth), 19u * 19u);
    EXPECT_EQ(moved(0), 0u);
}

}  // namespace
}  // namespace tvsgs
