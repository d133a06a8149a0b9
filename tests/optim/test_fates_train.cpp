// FatesGS' configurations: their needs, substitutes for missing inputs, and trainings that lower
// each term.
#include <map>

#include "core/scene/prior_maps.h"
#include "mvs/stereo/descriptors.h"
#include "optim/loop/train.h"
#include "pipeline/priors/priors.h"
#include "pipeline/scene/planned_scene.h"
#include "plan/memory.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

RunOptions options_of(const std::string& config) {
    RunOptions options;
    OptionTable table;
    options.add_to(table);
    table.read_file(TVSGS_SOURCE_DIR "/configs/" + config + ".json");
    return options;
}

constexpr int kWidth = 72, kHeight = 64;

/// Three views of a textured plane, with a prior of its depth order; the initial points are off the
/// plane by 3 % of their depth.
Scene plane_scene() {
    test::Random random(22);
    const Vec3d n = normalize(Vec3d{0.25, -0.2, -1});
    Scene scene;
    for (const float angle : {-0.2f, 0.0f, 0.2f}) {
        View view;
        view.camera = test::test_camera(kWidth, kHeight, angle);
        view.photo = ImageU8(kWidth, kHeight, 3);
        const auto R = mat_cast<double>(view.camera.camera_from_world.R);
        const Vec3d centre = vec_cast<double>(camera_centre(view.camera));
        ViewMap order{std::string(prior_map::kDepthOrder), kWidth, kHeight, 1, {}};
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x) {
                const Vec3d ray = vec_cast<double>(pixel_ray(view.camera, x, y));
                const double depth = -dot(n, centre) / dot(R * n, ray);
                const Vec3d p = centre + depth * transpose_times(R, ray);
                order.values.push_back(static_cast<float>((depth - 3) / 2.5));
                for (int k = 0; k < 3; ++k)
                    view.photo.at(x, y, k) = static_cast<std::uint8_t>(
                        128 + 50 * std::sin(8 * p.x + 2 * p.y + k) + 45 * std::sin(7 * p.y - k));
                if (x % 3 == 1 && y % 3 == 1) {
                    const double off = depth * (1 + 0.03 * random.normal());
                    scene.points.positions.push_back(
                        vec_cast<float>(centre + off * transpose_times(R, ray)));
                }
            }
        view.maps.push_back(std::move(order));
        scene.train.push_back(std::move(view));
    }
    scene.extent = 1;
    return scene;
}

TEST(FatesTraining, LowersEachOfItsTerms) {
    RunOptions options = options_of("fates_gs");
    options.train.iterations = 121;
    // More opaque than the default, for the dense cloud that the configuration expects.
    options.train.init.opacity = 0.7f;
    options.train.loss.normal_consistency.start = options.train.loss.distortion.start = 1;
    Scene scene = plane_scene();
    complete_maps(options.train.loss, scene.train);
    std::map<std::string, std::vector<double>> values;
    TrainCallbacks callbacks;
    callbacks.report_due = [](int) { return true; };
    callbacks.on_report = [&](const TrainReport& r) {
        for (const auto& [name, value] : r.terms) values[name].push_back(value);
    };
    train<Cpu>(scene, options.train, callbacks);
    ASSERT_EQ(values.size(), 6u);
    for (const auto& [name, of_step] : values) {
        const auto round = [&](std::size_t first) {
            return of_step[first] + of_step[first + 1] + of_step[first + 2];
        };
        EXPECT_GT(round(0), 0) << name;
        // Descriptors near the borders of these small photographs still differ at the end.
        EXPECT_LT(round(117), (name == "features" ? 0.97 : 0.75) * round(0)) << name;
    }
}

TEST(FatesConfigurations, HoldWhatTheirAuthorsHave) {
    for (const char* config : {"fates_gs", "tv_sgs_f"}) {
        const RunOptions options = options_of(config);
        EXPECT_NO_THROW(check_consistency(options.train));
        const DensifyOptions& d = options.train.densify;
        // Pruning keeps splats that gained no opacity, and removes splats that lost opacity.
        const auto logit = [](float o) { return std::log(o / (1 - o)); };
        EXPECT_LT(logit(d.min_opacity), logit(options.train.init.opacity));
        EXPECT_LT(logit(d.min_opacity), logit(d.reset_opacity));
        EXPECT_GT(d.min_opacity, 0.0999f);
        EXPECT_EQ(d.reset_opacity, options.train.init.opacity);
        EXPECT_EQ(options.train.tv.enabled, std::string(config) == "tv_sgs_f");
    }
}

TEST(ViewMaps, OneViewWithTheMapOfATermSuffices) {
    LossOptions loss;
    std::vector<View> views(2);
    complete_maps(loss, views);
    loss.depth_rank.weight = 1;
    EXPECT_THROW(complete_maps(loss, views), Error);
    views[1].maps.push_back({std::string(prior_map::kDepthOrder), 1, 1, 1, {0}});
    complete_maps(loss, views);
    EXPECT_TRUE(views[0].maps.empty());
}

TEST(ViewMaps, DescriptorsTakeThePlaceOfFeaturesAndNothingElseOfAnything) {
    LossOptions loss;
    loss.features.weight = 1;
    Scene scene = plane_scene();
    complete_maps(loss, scene.train);
    for (const View& view : scene.train) {
        ASSERT_EQ(view.maps.size(), 3u);
        EXPECT_EQ(view.maps[1].name, prior_map::kFeatures);
        EXPECT_EQ(view.maps[1].width_px, kWidth / 2);
        EXPECT_EQ(view.maps[2].name, prior_map::kCoarseFeatures);
        EXPECT_EQ(view.maps[2].height_px, kHeight / 4);
    }
    const auto before = scene.train[0].maps[1].values;
    complete_maps(loss, scene.train);  // their features exist already
    EXPECT_EQ(scene.train[0].maps.size(), 3u);
    EXPECT_EQ(scene.train[0].maps[1].values, before);

    Scene none = plane_scene();
    complete_maps({}, none.train);
    EXPECT_EQ(none.train[0].maps.size(), 1u) << "no term asks for features";
    for (View& view : none.train) view.maps.clear();
    loss.depth_smooth.weight = 1;
    try {
        complete_maps(loss, none.train);
        ADD_FAILURE() << "there is no prior";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::usage);
        for (const char* says : {"loss.depth_smooth", "'depth_order'", "3 training views"})
            EXPECT_NE(std::string(error.what()).find(says), std::string::npos) << error.what();
        EXPECT_EQ(std::string(error.what()).find("features"), std::string::npos) << error.what();
    }
}

TEST(MemoryPlan, CountsMapsWhetherAllOrFewAreOnTheDevice) {
    TrainOptions options;
    options.loss.features.weight = 1;
    Scene scene = plane_scene();
    for (const std::int64_t budget : {std::int64_t{0}, std::int64_t{1}}) {
        options.photo_bytes = budget;
        Scene larger = plane_scene();
        const std::int64_t bytes = add_descriptors(larger.train);
        const auto before = estimate_memory(scene, options, 100, true),
                   after = estimate_memory(larger, options, 100, true);
        // All three views, or the views of two steps with two neighbour views each.
        EXPECT_EQ(after.buffers.fixed - before.buffers.fixed, budget == 0 ? bytes : bytes / 3 * 6);
        EXPECT_EQ(after.host.fixed - before.host.fixed, bytes);
    }
}

}  // namespace
}  // namespace tvsgs
