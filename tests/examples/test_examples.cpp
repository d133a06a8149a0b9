// Compiles and runs the headers of examples/, which the pages of docs/develop/ explain.
#include <gtest/gtest.h>

#include "core/error.h"
#include "examples/toy_backbone.h"
#include "examples/toy_loss.h"
#include "examples/toy_mesher.h"
#include "optim/loop/train.h"
#include "optim/views/device_views.h"
#include "pipeline/mesh/mesh_extraction.h"
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
        const auto& images = backbone.forward(truth, view.camera, 0, Maps::color);
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

TEST(ToyBackbone, GradientsMatchItsImages) {
    Gaussians<Cpu> g = test::random_gaussians(10, 5, 0.1, 0), dL;
    const Camera camera = test::test_camera(40, 30, 0);
    examples::ToyBackbone backbone;
    const auto loss = [&] {
        double sum = 0;
        for (const Vec3f& c : to_host(backbone.forward(g, camera, 0, Maps::color).color))
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

/// The scene of dots; the first two views have maps darker than their photographs.
Scene scene_with_maps() {
    Scene scene = scene_of_dots();
    for (std::size_t v = 0; v < 2; ++v) {
        ViewMap map{"brightness", 40, 30};
        const ImageU8& photo = scene.train[v].photo;
        for (std::size_t p = 0; p < photo.pixels.size(); p += 3)
            map.values.push_back(
                static_cast<float>(photo.pixels[p] + photo.pixels[p + 1] + photo.pixels[p + 2]) /
                (4 * 255));
        scene.train[v].maps = {{"unread", 1, 1}, std::move(map)};
    }
    return scene;
}

double value_of(const TrainReport& report, std::string_view term) {
    for (const auto& [name, value] : report.terms)
        if (name == term) return value;
    return -1;
}

TEST(ToyLoss, DerivativesMatchItsValue) {
    examples::BrightnessLoss<Cpu> loss({3, 1});
    RenderedImages<Cpu> images;
    copy(std::vector<Vec3f>{{0.2f, 0.4f, 0.9f}, {1, 0, 0.3f}}, images.color);
    DeviceView<Cpu> view;
    view.maps.push_back({"brightness", 2, 1, 1, {}});
    copy(std::vector<float>{0.6f, 0.1f}, view.maps[0].values);
    const Gaussians<Cpu> none;
    const TensorField<Cpu> field;
    Objective<Cpu> objective;
    objective.dL_dimages.color.resize(2);
    objective.partial.resize(kSumBlocks);
    objective.values.resize(1);
    const auto value = [&] {
        objective.values.fill_zero(), objective.dL_dimages.color.fill_zero();
        loss.add_to(objective, {none, images, view, field, {}, 1});
        return objective.values[0];
    };
    value();
    const std::vector<Vec3f> dL = to_host(objective.dL_dimages.color);
    for (std::size_t p = 0; p < 2; ++p)
        for (int c = 0; c < 3; ++c) {
            float& x = images.color[p][c];
            const float kept = x;
            const double slope = test::central_difference(
                [&](double h) {
                    x = kept + static_cast<float>(h);
                    return value();
                },
                1e-2);
            x = kept;
            EXPECT_NEAR(dL[p][c], slope, 1e-4);
        }
    view.maps[0].values.resize(0);
    EXPECT_EQ(value(), 0) << "a view without the map";
}

TEST(ToyLoss, TrainsOnMapsThatComeWithTheViews) {
    add_backbone<Cpu>(
        "toy", [](const BackboneOptions&) { return std::make_unique<examples::ToyBackbone>(); });
    const ScheduledOptions weight{2, 11};
    add_loss<Cpu>({"brightness", weight.weight, examples::BrightnessLoss<Cpu>::kNeeds},
                  [&](const LossContext&) {
                      return std::make_unique<examples::BrightnessLoss<Cpu>>(weight);
                  });
    TrainOptions options;
    options.backbone = "toy";
    options.iterations = 120;
    options.densify.enabled = false;
    options.loss.photometric.weight = 0.01f;
    const Scene scene = scene_with_maps();
    std::vector<double> values;
    TrainCallbacks callbacks;
    callbacks.report_due = [](int) { return true; };
    callbacks.on_report = [&](const TrainReport& report) {
        values.push_back(value_of(report, "brightness"));
    };
    const auto resident = train<Cpu>(scene, options, callbacks, {}, {});
    for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(values[i], 0);
    const auto sum_of_round = [&](std::size_t from) {
        return values[from] + values[from + 1] + values[from + 2];
    };
    EXPECT_GT(sum_of_round(12), 0);
    EXPECT_LT(sum_of_round(117), 0.2 * sum_of_round(12));
    int none = 0;
    for (std::size_t i = 12; i < values.size(); ++i) none += values[i] == 0;
    EXPECT_EQ(none, 36) << "one view of three has no map";

    options.photo_bytes = 1;  // photographs and maps come from the host
    const auto streamed = train<Cpu>(scene, options, {}, {}, {});
    EXPECT_EQ(to_host(resident.opacity_logits), to_host(streamed.opacity_logits));
    add_loss<Cpu>({"brightness", 0, {}}, {});  // for the tests after this one
}

TEST(ViewMaps, MasksAreMapsAndNamesAreListedOnce) {
    Scene scene = scene_of_dots();
    scene.train[1].mask = ImageU8(40, 30, 1);
    scene.train[1].mask.pixels.assign(1200, 0);
    scene.train[1].mask.pixels[7] = 255;
    LossNeeds needs{.view_maps = {"mask", "depth"}};
    needs |= LossNeeds{.view_maps = {"depth"}};
    DeviceViews<Cpu> views(scene.train, needs, 0);
    EXPECT_EQ(views.get(0).maps.size(), 2u);
    EXPECT_EQ(views.get(0).map("mask"), nullptr);
    const DeviceMap<Cpu>* const mask = views.get(1).map("mask");
    ASSERT_NE(mask, nullptr);
    EXPECT_EQ(mask->values[6], 0);
    EXPECT_EQ(mask->values[7], 1);
    EXPECT_EQ(views.get(1).map("depth"), nullptr);
}

/// Stores the distance of each splat from the nearest camera; updates it every seventh step.
class KeepingBackbone : public examples::ToyBackbone {
public:
    void prepare(int step,
                 bool changed,
                 const std::vector<Camera>& cameras,
                 Gaussians<Cpu>& g) override {
        EXPECT_EQ(g.filter.size(), step == 0 ? 0 : g.means.size()) << step;
        EXPECT_EQ(cameras.size(), 3u);
        if (!changed && step % 7 != 0) return;
        g.filter.resize(g.means.size());
        for (std::size_t i = 0; i < g.means.size(); ++i) {
            g.filter[i] = 1e9f;
            for (const Camera& c : cameras)
                g.filter[i] = std::min(g.filter[i], norm(g.means[i] - camera_centre(c)));
        }
    }
    const RenderedImages<Cpu>& forward(const Gaussians<Cpu>& g,
                                       const Camera& camera,
                                       int sh_degree,
                                       Maps maps) override {
        EXPECT_EQ(g.filter.size(), g.means.size());
        return ToyBackbone::forward(g, camera, sh_degree, maps);
    }
};

/// An array that a backbone adds is grown, moved and saved with the splats.
TEST(ToyBackbone, ItsArrayIsPartOfTheSplats) {
    add_backbone<Cpu>("keeping",
                      [](const BackboneOptions&) { return std::make_unique<KeepingBackbone>(); });
    TrainOptions options;
    options.backbone = "keeping";
    options.iterations = 60;
    options.densify.from = 10, options.densify.every = 20, options.densify.trim_every = 30;
    options.densify.gradient_threshold = 0;  // so that all are cloned
    const Scene scene = scene_of_dots();
    std::vector<SharedState> saved;
    TrainCallbacks callbacks;
    callbacks.save_due = [](int done) { return done % 20 == 5; };
    callbacks.on_save = [&](int, const SharedState& state) { saved.push_back(state); };
    const auto whole = train<Cpu>(scene, options, callbacks, {}, {});
    ASSERT_EQ(saved.size(), 3u);
    ASSERT_EQ(whole.filter.size(), whole.means.size());
    ASSERT_GT(whole.size(), 60);
    for (const SharedState& state : saved) {
        EXPECT_EQ(state->get("filter", sizeof(float)).count(),
                  state->get("means", sizeof(Vec3f)).count());
        const auto rest = train<Cpu>(scene, options, {}, {}, state);
        EXPECT_EQ(to_host(rest.filter), to_host(whole.filter));
        EXPECT_EQ(to_host(rest.opacity_logits), to_host(whole.opacity_logits));
    }
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
    options.simplify.error = 0;
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
                     "mesh.method = 'gird': expected one of tsdf, tetrahedra, watertight, grid; "
                     "did you mean 'grid'?");
    }
}

}  // namespace
}  // namespace tvsgs
