// Removal of small components.
#include <gtest/gtest.h>

#include "mesh/mend/mend.h"

namespace tvsgs {
namespace {

/// Appends a strip of `faces` triangles with vertices of its own.
void add_strip(TriangleMesh& mesh, int faces) {
    const int first = static_cast<int>(mesh.vertices.size());
    for (int i = 0; i < faces + 2; ++i) {
        mesh.vertices.push_back(
            {static_cast<float>(i), static_cast<float>(i % 2), static_cast<float>(first)});
        mesh.colors.push_back({0, 0, static_cast<float>(first)});
    }
    for (int i = 0; i < faces; ++i) mesh.faces.push_back({first + i, first + i + 1, first + i + 2});
}

TEST(MeshClean, KeepsTheLargest) {
    TriangleMesh mesh;
    for (const int faces : {60, 100, 49, 80}) add_strip(mesh, faces);
    TriangleMesh one = mesh;
    const CleanReport report = keep_largest_components(one, 1);
    EXPECT_EQ(report.components, 4u);
    EXPECT_EQ(report.kept_components, 1u);
    EXPECT_EQ(one.faces.size(), 100u);
    EXPECT_EQ(one.vertices.size(), 102u);
    EXPECT_EQ(one.colors.size(), 102u);
    EXPECT_EQ(one.vertices[0].z, 62);  // the second strip
    EXPECT_EQ(one.colors[0].z, 62);
    EXPECT_EQ(one.faces[0].x, 0);
    EXPECT_EQ(report.removed_faces, 189u);

    // More than exist: a component still needs 50 faces.
    TriangleMesh many = mesh;
    EXPECT_EQ(keep_largest_components(many, 50).kept_components, 3u);
    TriangleMesh all = mesh;
    EXPECT_EQ(keep_largest_components(all, 0).kept_components, 4u);
    EXPECT_EQ(all.faces.size(), mesh.faces.size());
}

TEST(MeshClean, TiesKeepMore) {
    TriangleMesh mesh;
    for (const int faces : {70, 70, 60}) add_strip(mesh, faces);
    EXPECT_EQ(keep_largest_components(mesh, 1).kept_components, 2u);
}

TEST(MeshClean, ASharedVertexDoesNotConnect) {
    TriangleMesh mesh;
    mesh.vertices.resize(5);
    mesh.faces = {{0, 1, 2}, {2, 3, 4}};
    EXPECT_EQ(face_components(mesh), (std::vector<int>{0, 1}));
    mesh.faces = {{0, 1, 2}, {2, 3, 4}, {3, 2, 1}};  // connects both
    EXPECT_EQ(face_components(mesh), (std::vector<int>{0, 0, 0}));
}

TEST(MeshClean, OddInput) {
    TriangleMesh empty;
    EXPECT_EQ(keep_largest_components(empty, 1).components, 0u);
    empty.vertices.resize(3);
    keep_largest_components(empty, 1);
    EXPECT_EQ(empty.vertices.size(), 3u);  // unchanged

    TriangleMesh small;
    add_strip(small, 49);
    EXPECT_EQ(keep_largest_components(small, 5).kept_components, 0u);
    EXPECT_TRUE(small.vertices.empty());

    TriangleMesh repeated;
    add_strip(repeated, 60);
    repeated.faces[59] = {60, 60, 59};
    keep_largest_components(repeated, 1);
    EXPECT_EQ(repeated.faces.size(), 59u);
    EXPECT_EQ(repeated.vertices.size(), 61u);
}

}  // namespace
}  // namespace tvsgs
