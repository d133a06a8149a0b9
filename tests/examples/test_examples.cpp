// What docs/design.md tells a newcomer to write compiles, trains, and needs nothing of ours
// changed.
#include <gtest/gtest.h>

#include "core/error.h"
#include "examples/toy_backbone.h"
#include "examples/toy_mesher.h"
#include "optim/train.h"
#include "pipeline/mesh_extraction.h"
#include "support/numeric.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

Scene scene_of_dots() {
    const Gaussians<Cpu> truth = test::random_gaussians(60, 3, 0.1, 0);
    examples::ToyBackbone backbone;
    Scene scene;
    for (float angle : {-0.3f, 0.0f, 0.3f}) {
        View view;
        view.camera = test::test_camera(40, 30, angle);
        const auto& images = backbone.forward(truth, view.camera, 0, Maps::color, {});
        view.photo = ImageU8(40, 30, 3);
        for (std::size_t p = 0; p < images.color.size(); ++p)
            for (int c = 0; c < 3; ++c)
                view.photo.pixels[3 * p + static_cast<std::size_t>(c)] =
                    static_cast<std::uint8_t>(255 * std::clamp(images.color[p][c], 0.0f, 1.0f));
        scene.train.push_back(std::move(view));
    }
    for (const Vec3f& p : to_host(truth.means)) scene.points.positions.push_back(p);
    scene.extent = 2;
    return scene;
}

TEST(ToyBackbone, GradientsAreThoseOfItsImages) {
    Gaussians<Cpu> g = test::random_gaussians(10, 5, 0.1, 0), dL;
    const Camera camera = test::test_camera(40, 30, 0);
    examples::ToyBackbone backbone;
    const auto loss = [&] {
        double sum = 0;
        for (const Vec3f& c : to_host(backbone.forward(g, camera, 0, Maps::color, {}).color))
            sum += static_cast<double>(c.x + 2 * c.y - c.z);
        return sum;
    };
    loss();
    ImageGradients<Cpu> dL_dimages;
    copy(std::vector<Vec3f>(40 * 30, {1, 2, -1}), dL_dimages.color);
    resize(dL, g.size(), 0);
    fill_zero(dL);
    backbone.backward(g, dL_dimages, dL);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const float kept = g.opacity_logits[i];
        const double expected = test::central_difference(
            [&](double h) {
                g.opacity_logits[i] = kept + static_cast<float>(h);
                return loss();
            },
            1e-2);
        g.opacity_logits[i] = kept;
        EXPECT_NEAR(dL.opacity_logits[i], expected, 0.02 + 0.02 * std::abs(expected));
    }
}

TEST(ToyBackbone, TrainsByItsName) {
    add_backbone<Cpu>(
        "toy", [](const BackboneOptions&) { return std::make_unique<examples::ToyBackbone>(); });
    TrainOptions options;
    options.backbone = "toy";
    options.iterations = 120;
    options.densify.from = 20, options.densify.every = 20, options.densify.trim_every = 50;
    std::vector<double> losses;
    TrainCallbacks callbacks;
    callbacks.report_due = [](int step) { return step % 30 == 10; };
    callbacks.on_report = [&](const TrainReport& report) { losses.push_back(report.loss); };
    const Scene scene = scene_of_dots();
    const auto trained = train<Cpu>(scene, options, callbacks, {}, {});
    ASSERT_EQ(losses.size(), 4u);
    EXPECT_LT(losses.back(), 0.5 * losses.front());
    EXPECT_GT(trained.size(), 0);
}

/// Flat, opaque splats in the plane z = 0.
Gaussians<Cpu> wall_of_splats() {
    constexpr int kEdge = 30;
    Gaussians<Cpu> g;
    resize(g, kEdge * kEdge, 0);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const auto at = [](std::size_t k) { return 2.4f * (static_cast<float>(k) / kEdge - 0.5f); };
        g.means[i] = {at(i % kEdge), at(i / kEdge), 0};
        g.log_scales[i] = {std::log(0.08f), std::log(0.08f), std::log(0.001f)};
        g.quats[i] = {1, 0, 0, 0};
        g.opacity_logits[i] = 6;
        g.sh[i] = {1, 0, 0};
    }
    return g;
}

TEST(ToyMesher, MeshesByItsName) {
    add_mesher<Cpu>("grid", [] { return std::make_unique<examples::GridMesher>(); });
    const Gaussians<Cpu> wall = wall_of_splats();
    std::vector<View> views(2);
    views[0].camera = test::test_camera(40, 30, -0.3f);
    views[1].camera = test::test_camera(40, 30, 0.3f);
    MeshOptions options;
    options.method = "grid";
    options.box = "-0.5,-0.5,-1,0.5,0.5,1";
    const TriangleMesh mesh = extract_mesh<Cpu>(views, wall, {}, options, testing::TempDir());
    ASSERT_GT(mesh.faces.size(), 100u);
    EXPECT_EQ(mesh.colors.size(), mesh.vertices.size());
    for (const Vec3f v : mesh.vertices) {
        EXPECT_NEAR(v.z, 0, 0.02);  // a quarter of a pixel, 4 / (1.3 * 40)
        EXPECT_LE(std::max(std::abs(v.x), std::abs(v.y)), 0.5f) << "boxes are for all meshers";
    }
    for (const Vec3i f : mesh.faces) {  // towards the cameras, which look along +z
        const auto vertex = [&](int i) { return mesh.vertices[static_cast<std::size_t>(i)]; };
        const Vec3f a = vertex(f.x), b = vertex(f.y), c = vertex(f.z);
        EXPECT_LT(cross(b - a, c - a).z, 0);
    }

    options.method = "gird";
    try {
        check_mesh_options(options);
        FAIL() << "there is no such mesher";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::usage);
        EXPECT_STREQ(error.what(),
                     "mesh.method = 'gird': expected one of tsdf, grid; did you mean 'grid'?");
    }
}

}  // namespace
}  // namespace tvsgs
