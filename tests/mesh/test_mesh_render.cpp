// The mesh renderer against closed forms.
#include <gtest/gtest.h>

#include <cmath>

#include "core/device/threads.h"
#include "mesh/draw/mesh_render.h"

namespace tvsgs {
namespace {

Camera test_camera(int width = 64, int height = 48) {
    Camera camera;
    camera.width_px = width, camera.height_px = height;
    camera.fx_px = 60, camera.fy_px = 61, camera.cx_px = 31, camera.cy_px = 25;
    const Quatf q = normalize(Quatf{1, 0.1f, -0.2f, 0.05f});
    camera.camera_from_world = {rotation(q), {0.1f, -0.2f, 0.3f}};
    return camera;
}

/// Two triangles that cover the plane n.p = distance of the camera frame beyond the image.
TriangleMesh plane(const Camera& camera, Vec3f n, float distance) {
    const Rigid3f world_from_camera = inverse(camera.camera_from_world);
    TriangleMesh mesh;
    for (const auto& [x, y] : {std::pair{-3.f, -3.f}, {3.f, -3.f}, {3.f, 3.f}, {-3.f, 3.f}}) {
        mesh.vertices.push_back(world_from_camera *
                                Vec3f{x, y, (distance - n.x * x - n.y * y) / n.z});
        mesh.colors.push_back({0.5f + 0.1f * x, 0.5f + 0.1f * y, 0.25f});
    }
    mesh.faces = {{0, 2, 1}, {0, 3, 2}};
    return mesh;
}

TEST(MeshRender, PlaneHasItsExactDepthNormalAndColor) {
    const Camera camera = test_camera();
    const Vec3f n = normalize(Vec3f{0.3f, -0.2f, 1});
    const MeshRender render = render_mesh(plane(camera, n, 2), camera);
    for (int y = 0; y < camera.height_px; ++y)
        for (int x = 0; x < camera.width_px; ++x) {
            const Vec3f ray = pixel_ray(camera, x, y);
            const float depth = 2 / dot(n, ray);
            ASSERT_NE(render.face.at(x, y), -1) << "a hole at " << x << ", " << y;
            // Float rounding of vertices near 5 and of the stored depth.
            ASSERT_NEAR(render.depth.at(x, y), depth, 2e-6f * depth);
            for (int c = 0; c < 3; ++c) ASSERT_NEAR(render.normal.at(x, y, c), -n[c], 2e-6f);
            // Linear over the plane, not over the image.
            ASSERT_NEAR(render.color.at(x, y, 0), 0.5f + 0.1f * depth * ray.x, 2e-6f);
            ASSERT_NEAR(render.color.at(x, y, 1), 0.5f + 0.1f * depth * ray.y, 2e-6f);
        }
}

TEST(MeshRender, NearestSurfaceWinsInAnyOrder) {
    const Camera camera = test_camera();
    TriangleMesh both = plane(camera, {0, 0, 1}, 2);
    const TriangleMesh far = plane(camera, {0, 0, 1}, 3);
    both.vertices.insert(both.vertices.end(), far.vertices.begin(), far.vertices.end());
    both.colors.clear();
    for (const bool far_first : {false, true}) {
        both.faces = {{0, 2, 1}, {0, 3, 2}, {4, 6, 5}, {4, 7, 6}};
        if (far_first)
            std::swap(both.faces[0], both.faces[2]), std::swap(both.faces[1], both.faces[3]);
        const MeshRender render = render_mesh(both, camera);
        for (const float depth : render.depth.pixels) ASSERT_NEAR(depth, 2, 4e-6f);
    }
}

TEST(MeshRender, SurfaceThroughTheCameraPlaneIsCutThere) {
    // The ground below a horizontal camera that reaches behind it: one triangle that cannot be
    // projected.
    Camera camera = test_camera();
    camera.camera_from_world = {};
    TriangleMesh ground;
    ground.vertices = {{-100, 1, -50}, {100, 1, -50}, {0, 1, 400}};
    ground.faces = {{0, 1, 2}};
    const MeshRender render = render_mesh(ground, camera);
    for (int y = 0; y < camera.height_px; ++y) {
        const float slope = pixel_ray(camera, 31, y).y;
        if (slope < 1.0f / 400)  // the triangle ends at depth 400
            EXPECT_EQ(render.face.at(31, y), -1) << y;
        else
            EXPECT_NEAR(render.depth.at(31, y), 1 / slope, 1e-5f / slope) << y;
    }
}

TEST(MeshRender, CoverageOfAnEdgeIsFiltered) {
    // A half plane whose edge crosses the pixels at one half: 4 x 4 samples see it exactly.
    Camera camera = test_camera(16, 8);
    camera.camera_from_world = {};
    camera.fx_px = camera.fy_px = 10, camera.cx_px = 8, camera.cy_px = 4;
    TriangleMesh half;
    half.vertices = {{0.05f, -9, 1}, {9, -9, 1}, {9, 9, 1}, {0.05f, 9, 1}};  // starts at x = 8.5 px
    half.faces = {{0, 1, 2}, {0, 2, 3}};
    const MeshRender render = render_mesh(half, camera, {.supersampling = 4});
    for (int y = 0; y < 8; ++y)
        for (int x = 0; x < 16; ++x)
            EXPECT_EQ(render.color.at(x, y), x < 8 ? 0 : x == 8 ? 0.5f : 1) << x << ", " << y;
}

TEST(MeshRender, EmptyMeshAndUnusedVertices) {
    const Camera camera = test_camera();
    TriangleMesh mesh;
    EXPECT_EQ(render_mesh(mesh, camera, {.background = {0.5f, 0, 0}}).color.at(3, 4), 0.5f);
    EXPECT_EQ(preview_mesh(mesh, preview_camera(mesh, {camera}, 32, 24)).width, 32);
    mesh.vertices.push_back({1, 2, 3});
    EXPECT_EQ(norm(vertex_normals(mesh)[0]), 0);
}

TEST(MeshRender, DoesNotDependOnThreads) {
    const Camera camera = test_camera();
    const TriangleMesh mesh = plane(camera, normalize(Vec3f{0.3f, -0.2f, 1}), 2);
    const int before = thread_count();
    set_thread_count(1);
    const ImageF one = render_mesh(mesh, camera, {.supersampling = 3}).color;
    set_thread_count(7);
    const ImageF many = render_mesh(mesh, camera, {.supersampling = 3}).color;
    set_thread_count(before);
    EXPECT_EQ(one.pixels, many.pixels);
}

TEST(MeshRender, PreviewTintsTheInside) {
    Camera camera = test_camera();
    TriangleMesh mesh = plane(camera, {0, 0, 1}, 2);
    mesh.colors.clear();
    const auto redness = [&] {
        const ImageU8 image = preview_mesh(mesh, camera);
        return image.at(32, 24, 0) - image.at(32, 24, 2);
    };
    EXPECT_EQ(redness(), 0);
    for (Vec3i& face : mesh.faces) std::swap(face.y, face.z);
    EXPECT_GT(redness(), 50);
}

TEST(MeshRender, PreviewFramesTheMeshAsTheCamerasSeeIt) {
    const Camera camera = test_camera();
    TriangleMesh mesh = plane(camera, normalize(Vec3f{0.2f, 0.1f, 1}), 2);
    for (Vec3f& vertex : mesh.vertices) vertex = 100.0f * vertex + Vec3f{0, 0, 30};
    Camera turned = camera;  // looks elsewhere
    turned.camera_from_world.R = Mat3f{{{0, 0, -1}, {0, 1, 0}, {1, 0, 0}}};
    const Camera view = preview_camera(mesh, {turned, camera, turned}, 96, 48);
    EXPECT_EQ(view.width_px, 96);
    EXPECT_EQ(view.camera_from_world.R[2][2], camera.camera_from_world.R[2][2]);
    float left = 96, right = 0, top = 48, bottom = 0;
    for (const Vec3f& vertex : mesh.vertices) {
        const Vec3f p = view.camera_from_world * vertex;
        ASSERT_GT(p.z, 0);
        const float x = view.fx_px * p.x / p.z + view.cx_px,
                    y = view.fy_px * p.y / p.z + view.cy_px;
        left = std::min(left, x), right = std::max(right, x);
        top = std::min(top, y), bottom = std::max(bottom, y);
    }
    EXPECT_TRUE(left >= 0 && right <= 96 && top >= 0 && bottom <= 48)
        << left << ' ' << right << ' ' << top << ' ' << bottom;
    EXPECT_GT(std::max((right - left) / 96, (bottom - top) / 48), 0.7f) << "it fills the picture";
}

TEST(MeshRender, EightBitValuesAreRoundedAndClamped) {
    ImageF image(4, 1, 1);
    image.pixels = {-1, 0.5f, 2, std::nanf("")};
    EXPECT_EQ(to_8bit(image).pixels, (std::vector<std::uint8_t>{0, 128, 255, 0}));
}

}  // namespace
}  // namespace tvsgs
