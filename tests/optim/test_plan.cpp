// The plan: its measurements, and its decisions on both sides of each threshold.
#include <gtest/gtest.h>

#include <utility>

#include "core/device/threads.h"
#include "plan/decide.h"
#include "plan_scene.h"
#include "training_scene.h"

namespace tvsgs {
namespace {

using namespace test;

TEST(PlanLook, MeasuresWhatTheSceneWasMadeWith) {
    const SceneLook look = look_of(patch_scene(5, 6, 1600));
    EXPECT_EQ(look.train_views, 5);
    EXPECT_EQ(look.pixels, 8000);
    EXPECT_NEAR(look.points_per_pixel, 1600 / 8000., 1e-12) << "all points lie in all views";
    EXPECT_EQ(look.views_in_pairs, 1);
    EXPECT_NEAR(look.exposure_drift, 0, 0.01) << "as below";
}

TEST(PlanLook, AFewThousandPointsStandForMany) {
    // Uses every fourth of 12,800 points, which are all visible in all views.
    EXPECT_NEAR(look_of(patch_scene(2, 6, 12800)).points_per_pixel, 12800 / 8000., 0.04);
}

TEST(PlanLook, WithoutPointsNothingIsMadeUp) {
    const SceneLook look = look_of(patch_scene(3, 10, 0));
    EXPECT_EQ(look.points_per_pixel, 0);
    EXPECT_TRUE(std::isnan(look.exposure_drift));
    const auto plan = plan_of(look);
    EXPECT_EQ(choice(plan, "exposure"), "no correction");
    EXPECT_EQ(choice(plan, "new splats"), "yes");
}

TEST(Plan, PosesAreRefinedWhereTheirPointsAskForIt) {
    SceneLook look;
    const auto refined = [&] { return settings(plan_of(look), "cameras")[0].second; };
    EXPECT_EQ(refined(), "false") << "nothing is known";
    look.pose_error = 0.49;
    EXPECT_EQ(refined(), "false");
    look.pose_error = 0.51;
    EXPECT_EQ(refined(), "true");
    Scene scene = patch_scene(5, 6, 1600);
    EXPECT_TRUE(std::isnan(look_of(scene).pose_error));
    const double errors[] = {0.1, NAN, 3, 0.7, NAN};
    for (std::size_t i = 0; i < 5; ++i) scene.train[i].pose_error_px = errors[i];
    EXPECT_EQ(look_of(scene).pose_error, 0.7);
}

TEST(Plan, GoodPosesHardlyMoveThoughAskedTo) {
    const auto bound = [](double error) {
        SceneLook look;
        look.pose_error = error;
        TrainingInputs in;
        in.options.cameras.refine = true;
        return std::stod(settings(decide_training(look, in), "cameras").at(1).second);
    };
    EXPECT_EQ(bound(0), 1e-3);
    EXPECT_EQ(bound(0.25), 1e-3);
    EXPECT_NEAR(bound(0.3), 1.6, 1e-4) << "a fifth of 8 px";
    EXPECT_NEAR(bound(0.4999), 8, 0.01) << "the slope ends where the plan refines";
}

TEST(Plan, SettingsByTheNumberOfViews) {
    EXPECT_EQ(decide_settings(39, false).choice, kFewPhotographs);
    EXPECT_EQ(decide_settings(40, false).choice, kManyPhotographs);
    EXPECT_EQ(decide_settings(40, true).choice, kFewPhotographs) << "measured points need votes";
}

TEST(Plan, SaysWhereTheFullSizeWouldDecideOtherwise) {
    SceneLook look;
    look.points = 10000, look.pixels = 20000, look.points_per_pixel = 0.5;
    const auto says = [&](double reduction) {
        look.reduction = reduction;
        return decide_cloud(look, false).reason.find("at the photographs' full size") !=
               std::string::npos;
    };
    EXPECT_FALSE(says(1));
    EXPECT_FALSE(says(1.1));  // 0.41 there
    EXPECT_TRUE(says(1.2));   // 0.35
    look.points_per_pixel = 0.2;
    EXPECT_FALSE(says(8));
}

TEST(Plan, StereoWhereTheCloudDoesNotCoverInFull) {
    for (const bool covering : {false, true}) {
        // 3,200 points on 8,000 pixels are 0.4 per pixel.
        const SceneLook look = look_of(patch_scene(3, 10, covering ? 3300 : 3100));
        const Decision cloud = decide_cloud(look, false);
        EXPECT_EQ(cloud.choice, covering ? "the model's" : "stereo");
        // The option makes the same choice: stereo makes a cloud where there are fewer points.
        EXPECT_EQ(std::stod(cloud.settings.at(0).second) > static_cast<double>(look.points),
                  !covering);
        ASSERT_EQ(cloud.settings.size(), covering ? 1 : 2);
        if (covering) continue;
        EXPECT_EQ(cloud.settings[1].first, "init.max_points");
        EXPECT_EQ(std::stod(cloud.settings[1].second),
                  std::ceil(0.6 * static_cast<double>(look.points) / look.points_per_pixel));
    }
    EXPECT_EQ(decide_cloud(look_of(patch_scene(3, 10, 0)), false).settings.size(), 1)
        << "without points of the model the size of the scene is not known";
}

TEST(Plan, CoverageByDegrees) {
    EXPECT_EQ(covered_share(0), 0);
    EXPECT_EQ(covered_share(0.02), 0);
    EXPECT_NEAR(covered_share(0.06), 0.5, 1e-12);
    EXPECT_EQ(covered_share(0.1), 1);
    EXPECT_EQ(covered_share(7), 1);
    EXPECT_EQ(covered_share(std::nan("")), 0) << "not known";
}

TEST(Plan, DecisionsSayWhereOnTheSlopeTheyAre) {
    SceneLook look;
    look.train_views = 3;
    const auto reason = [&](double points_per_pixel) {
        look.points_per_pixel = points_per_pixel;
        for (const Decision& decision : plan_of(look))
            if (decision.name == "new splats") return decision.reason;
        return std::string();
    };
    EXPECT_EQ(reason(0.01), "0.01 start points per textured pixel: too few (0.02 or more help)");
    EXPECT_EQ(
        reason(0.05),
        "0.05 start points per textured pixel: 38 % of the way from 0.02 to the 0.1 that cover the "
        "scene");
    EXPECT_EQ(reason(0.776), "0.78 start points per textured pixel: they cover the scene");
}

TEST(Plan, DenseSettingsKeepTheirGrowth) {
    const SceneLook near = look_of(patch_scene(25, 2, 1600)),
                    far = look_of(patch_scene(3, 38, 1600));
    const auto plan = plan_of(near, true);
    EXPECT_EQ(choice(plan, "iterations"), "15000");
    EXPECT_EQ(choice(plan, "new splats"), "no such decision");
    EXPECT_FALSE(sets(settings(plan, "multi-view"), "loss.features.weight", "0"))
        << "not one of the dense settings";
    EXPECT_TRUE(sets(settings(plan, "multi-view"), "loss.multi_view_geometry.weight", "0.25"));
    EXPECT_TRUE(
        sets(settings(plan_of(far, true), "multi-view"), "loss.multi_view_geometry.weight", "0"));
    EXPECT_EQ(decide_cloud(look_of(patch_scene(25, 2, 1999)), true).choice, "stereo");
    EXPECT_EQ(decide_cloud(look_of(patch_scene(25, 2, 2000)), true).choice, "the model's");
}

TEST(Plan, DiscsForCoveringCloudsWhereTheyMayBeChosen) {
    const SceneLook covered = look_of(patch_scene(3, 10, 3600)),
                    sparse = look_of(patch_scene(3, 10, 100));
    TrainingInputs in;
    in.configured = 15000;
    EXPECT_EQ(choice(decide_training(covered, in), "rasteriser"), "no such decision");
    in.discs = true;
    const auto plan = decide_training(covered, in);
    EXPECT_TRUE(sets(settings(plan, "rasteriser"), "backbone", kDiscs));
    EXPECT_TRUE(sets(settings(plan, "rasteriser"), "output.ply_scales", "three"));
    EXPECT_EQ(choice(decide_training(sparse, in), "rasteriser"), "no such decision");
    in.dense = true;
    EXPECT_EQ(choice(decide_training(covered, in), "rasteriser"), "no such decision");
}

TEST(Plan, NormalsOfStereoForFewViewsAndLessForMore) {
    SceneLook look = look_of(patch_scene(3, 10, 3600));
    TrainingInputs in;
    in.configured = 15000;
    EXPECT_EQ(choice(decide_training(look, in), "prior normals"), "no such decision");
    in.normals = true;
    const auto weight = [&](int views) {
        look.train_views = views;
        return choice(decide_training(look, in), "prior normals");
    };
    for (const auto& [views, expected] : {std::pair(3, "weight 1"),
                                          {9, "weight 1"},
                                          {10, "weight 0.90909"},
                                          {19, "weight 0.090909"},
                                          {20, "no such decision"}})
        EXPECT_EQ(weight(views), expected) << views;
    look.train_views = 3;
    const Settings of_stereo = settings(decide_training(look, in), "prior normals");
    EXPECT_TRUE(sets(of_stereo, "loss.prior_normal.weight", "1"));
    EXPECT_TRUE(sets(of_stereo, "priors.source", "stereo"));
    look.points_per_pixel = 0.06, look.train_views = 3;
    EXPECT_EQ(weight(3), "weight 0.5");
    look.points_per_pixel = 0.02;
    EXPECT_EQ(weight(3), "no such decision");
}

TEST(Plan, LargeSplatsOfACoveringCloudAreNotMeshed) {
    SceneLook look = look_of(patch_scene(3, 10, 3600));
    for (const int views : {1, 3, 9, 20}) {
        look.train_views = views;
        TrainingInputs by_stereo;
        by_stereo.configured = by_stereo.options.iterations = 15000, by_stereo.supported = true;
        const std::vector<Decision> plan = decide_training(look, by_stereo);
        EXPECT_TRUE(sets(settings(plan, "meshed splats"), "mesh.max_scale_px", "16")) << views;
    }
    for (const auto& [views, px] : {std::pair(1, "16"), {3, "16"}, {4, "32"}, {8, "512"}}) {
        look.train_views = views;
        EXPECT_TRUE(sets(settings(plan_of(look), "meshed splats"), "mesh.max_scale_px", px))
            << views;
    }
    look.train_views = 9;
    EXPECT_EQ(choice(plan_of(look), "meshed splats"), "no such decision");
    const auto sparse = plan_of(look_of(patch_scene(3, 10, 100)));
    EXPECT_EQ(choice(sparse, "meshed splats"), "no such decision");
}

TEST(Plan, OneOfManyViewsIsTrustedFurther) {
    SceneLook look = look_of(patch_scene(3, 10, 3600));
    const auto expect_none = [&](bool dense = false) {
        EXPECT_EQ(choice(plan_of(look, dense), "single views"), "no such decision");
    };
    const auto expect = [&](int views, const char* jump_px) {
        look.train_views = views;
        const auto plan = plan_of(look);
        EXPECT_TRUE(sets(settings(plan, "single views"), "mesh.single_view_jump_px", jump_px))
            << views;
    };
    expect(1, "0.1");
    expect(3, "0.1");
    expect(4, "0.14678");
    expect(6, "0.31623");
    expect(9, "1");
    expect(20, "1");
    look.points_per_pixel = 0.07;  // five eighths of the way to a covering cloud
    expect(9, "0.5946");
    expect(3, "0.141");
    look.points_per_pixel = 0.02;
    expect_none();
    look.points_per_pixel = 1;
    expect_none(true);
}

TEST(Plan, MeshesOfManyPixelsAreCoarser) {
    SceneLook look = look_of(patch_scene(3, 10, 3600));
    EXPECT_NEAR(look.megapixels, 3e-6 * 100 * 80, 1e-9);
    for (const double few : {0.0, 1.44, 2.0}) {
        look.megapixels = few;
        EXPECT_EQ(choice(plan_of(look), "mesh error"), "no such decision") << few;
    }
    for (const double few : {0.0, 2.01, 4.5}) {
        look.megapixels = few;
        EXPECT_EQ(choice(plan_of(look), "mesh voxels"), "no such decision") << few;
    }
    const auto expect = [&](double megapixels, const char* error, const char* voxels) {
        look.megapixels = megapixels;
        for (const bool dense : {false, true}) {
            const auto plan = plan_of(look, dense);
            EXPECT_TRUE(sets(settings(plan, "mesh error"), "mesh.error", error)) << megapixels;
            EXPECT_TRUE(sets(settings(plan, "mesh voxels"), "mesh.voxel_scale", voxels))
                << megapixels;
        }
    };
    expect(5.5, "0.4", "1.0556");
    expect(6.75, "0.43571", "1.125");
    expect(9.0, "0.5", "1.25");
    expect(400.0, "0.5", "1.25");
    look.megapixels = 2.01;  // no step
    EXPECT_EQ(choice(plan_of(look), "mesh error"), "0.30029 px");
    look.megapixels = 4.51;
    EXPECT_EQ(choice(plan_of(look), "mesh voxels"), "1.0006 px");
}

TEST(Plan, TheScheduleFitsTheIterationsThatAreAskedFor) {
    EXPECT_EQ(choice(plan_of(look_of(patch_scene(3, 10, 1)), false, 0), "iterations"), "0");
    const auto plan = plan_of(look_of(patch_scene(3, 10, 1)), false, 300);
    EXPECT_EQ(choice(plan, "iterations"), "300");
    EXPECT_TRUE(sets(settings(plan, "iterations"), "loss.tv_normal.start", "60"));
}

TEST(Plan, NothingIsDecidedForVotingThatIsOff) {
    TrainingInputs in;
    in.configured = 15000, in.options.tv.enabled = false;
    const auto plan = decide_training(look_of(patch_scene(3, 10, 3600)), in);
    for (const char* name : {"votes", "position loss", "neighbours"})
        EXPECT_EQ(choice(plan, name), "no such decision");
    EXPECT_EQ(choice(plan, "multi-view"), "100 %");
}

TEST(Plan, MultiViewLossesWaitForOpaqueSplats) {
    for (const auto& [wanted, start] :
         {std::pair(-1, "250"), {0, "1"}, {300, "15"}, {10, "1"}, {15000, "250"}})
        for (const char* term : {"geometry", "ncc"})
            EXPECT_TRUE(sets(
                settings(plan_of(look_of(patch_scene(3, 10, 3600)), false, wanted), "multi-view"),
                std::string("loss.multi_view_") + term + ".start", start))
                << wanted;
}

TEST(Plan, IterationsByTheNumberOfViews) {
    for (const auto& [views, iterations] : {std::pair(20, "5000"), std::pair(21, "5250")})
        EXPECT_EQ(choice(plan_of(look_of(patch_scene(views, 2, 3600))), "iterations"), iterations);
    SceneLook many = look_of(patch_scene(3, 2, 3600));
    many.train_views = 61;
    EXPECT_EQ(choice(plan_of(many), "iterations"), "15000") << "no more than the settings have";
}

TEST(Plan, MeasuresTheAngleBetweenPairs) {
    for (const double step_deg : {20.0, 36.0, 50.0}) {
        const SceneLook look = look_of(patch_scene(3, step_deg, 3600));
        EXPECT_NEAR(look.pair_angle_deg, step_deg, 0.01);
        EXPECT_EQ(look.views_in_widest_pairs, 1);
        EXPECT_EQ(look.views_in_wide_pairs, step_deg < 37 ? 1 : 0);
    }
}

TEST(Plan, MultiViewLossesWhereAViewHasAnother) {
    // Angle of optical axes: 30 degrees, or up to 37 for views without another pair.
    for (const auto& [step_deg, on] : {std::pair(29.0, true), {36.0, true}, {38.0, false}}) {
        const auto plan = plan_of(look_of(patch_scene(3, step_deg, 3600)));
        EXPECT_EQ(choice(plan, "multi-view"), on ? "100 %" : "off");
        EXPECT_TRUE(sets(settings(plan, "multi-view"), "loss.multi_view.fallback_angle_deg", "37"));
        EXPECT_TRUE(
            sets(settings(plan, "multi-view"), "loss.multi_view_ncc.weight", on ? "0.5" : "0"));
    }
    // One pair is enough; the other views of five have none.
    Scene scene = patch_scene(5, 50, 3600);
    scene.train[0].camera.camera_from_world = scene.train[1].camera.camera_from_world;
    scene.train[0].camera.camera_from_world.t.x += 0.3f;
    const SceneLook look = look_of(scene);
    EXPECT_NEAR(look.views_in_pairs, 0.4, 1e-12);
    EXPECT_EQ(choice(plan_of(look), "multi-view"), "100 %");
}

TEST(Plan, ExposureByTheBrightnessOfSharedPoints) {
    for (const double gain : {1.13, 1.17}) {  // the threshold is 15 %
        Scene scene = patch_scene(4, 10, 1600);
        scene.train[0].photo = photo_of_plane(scene.train[0].camera, gain);
        const SceneLook look = look_of(scene);
        // Grey levels are integers, and pixels of two views differ by up to half a pixel.
        EXPECT_NEAR(look.exposure_drift, gain - 1, 0.015);
        EXPECT_EQ(choice(plan_of(look), "exposure"), gain < 1.15 ? "no correction" : "fitted");
    }
    // Hidden points are ignored: here the second view shows another texture.
    Scene hidden = patch_scene(2, 10, 1600);
    ImageU8& photo = hidden.train[1].photo;
    for (int y = 0; y < photo.height; ++y)
        for (int x = 0; x < photo.width; ++x)
            for (int c = 0; c < 3; ++c) photo.at(x, y, c) = (x / 3 + y / 2) % 2 ? 200 : 150;
    EXPECT_TRUE(std::isnan(look_of(hidden).exposure_drift));
}

TEST(WhatIsOff, IsNeitherRunNorAllocated) {
    const int threads = thread_count();
    set_thread_count(2);  // each thread has scratch memory
    TrainOptions o = test::everything_on(12);
    const Scene scene = test::rendered_scene();
    const auto train_now = [&](const TrainOptions& options) {
        TrainCallbacks callbacks;
        callbacks.profile = true;
        std::vector<std::string> stages;
        SharedState state;
        callbacks.report_due = [&](int step) { return step == 12; };
        callbacks.on_report = [&](const TrainReport& report) {
            for (const StageTime& stage : report.stages) stages.emplace_back(stage.name);
            for (const auto& [name, value] : report.terms) stages.emplace_back(name);
        };
        callbacks.save_due = [](int done) { return done == 11; };
        callbacks.on_save = [&](int, const SharedState& saved) { state = saved; };
        train<Cpu>(scene, options, callbacks);
        return std::tuple(stages, state, memory_use(Cpu{}).peak_bytes);
    };
    const auto has = [](const std::vector<std::string>& list, const std::string& name) {
        return std::find(list.begin(), list.end(), name) != list.end();
    };
    const auto bytes = [](const SharedState& state, const std::string& name) {
        const StateArray* const array = state->find(name);
        return array == nullptr ? std::size_t{0} : array->count();
    };
    const char* const parts[] = {"voting", "other views", "tv_normal", "multi_view_ncc", "normal"};
    TrainOptions bare = o;
    bare.tv.enabled = bare.densify.enabled = false;
    bare.loss.photometric.exposure = false;
    bare.loss.tv_normal.weight = bare.loss.tv_position.weight = bare.loss.normal.weight = 0;
    bare.loss.multi_view_geometry.weight = bare.loss.multi_view_ncc.weight = 0;
    // First, as peaks count from the start of the program.
    const auto [off, state_off, peak_off] = train_now(bare);
    for (const char* name : parts) EXPECT_FALSE(has(off, name)) << name;
    EXPECT_EQ(bytes(state_off, "tv.tensors"), 0u);
    EXPECT_EQ(bytes(state_off, "densify.statistics"), 0u);

    const auto [on, state_on, peak_on] = train_now(o);
    for (const char* name : parts) EXPECT_TRUE(has(on, name)) << name;
    EXPECT_GT(bytes(state_on, "tv.tensors"), 0u);
    EXPECT_GT(bytes(state_on, "densify.statistics"), 0u);
    EXPECT_GT(peak_on, 2 * peak_off) << "lists, votes and a second render";
    set_thread_count(threads);
}

}  // namespace
}  // namespace tvsgs
