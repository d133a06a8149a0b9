// The memory estimate of a training, and the decisions of the plan.
#include <gtest/gtest.h>

#include "optim/losses/loss.h"
#include "pipeline/run/run_folder.h"
#include "plan/decide.h"
#include "plan/memory.h"
#include "render/backbone.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

Scene scene_of(int views) {
    Scene scene;
    scene.path = "./made";
    for (int i = 0; i < views; ++i) {
        View view;
        view.camera.width_px = 200, view.camera.height_px = 100;
        view.photo = ImageU8(200, 100, 3);
        scene.train.push_back(std::move(view));
    }
    return scene;
}

TEST(MemoryPlan, CountsWhatTermsKeepOfEachView) {
    TrainOptions keeps, does_not;
    keeps.loss.multi_view_ncc.weight = does_not.loss.multi_view_ncc.weight = 1;
    keeps.loss.anchored_depth.weight = 1;  // also uses a neighbour view
    for (const int views : {3, 7}) {
        const Scene scene = scene_of(views);
        const MemoryPlan a = estimate_memory(scene, keeps, 100, true),
                         b = estimate_memory(scene, does_not, 100, true);
        EXPECT_EQ(a.buffers.fixed - b.buffers.fixed, views * 200 * 100 * 4);
        EXPECT_EQ(a.host.fixed - b.host.fixed, 2 * views * 200 * 100 * 4);  // checkpoints
        EXPECT_EQ(a.buffers.per_splat, b.buffers.per_splat);
    }
}

TEST(MemoryPlan, CountsMapsOfViewsThatComeAsTheyAreNeeded) {
    Scene scene = scene_of(9);
    TrainOptions o;
    o.photo_bytes = 1;
    const std::int64_t without = estimate_memory(scene, o, 100, true).buffers.fixed;
    for (View& view : scene.train)
        view.maps.push_back({"depth", 200, 100, 1, std::vector<float>(200 * 100)});
    const std::int64_t with = estimate_memory(scene, o, 100, true).buffers.fixed;
    EXPECT_EQ(with - without, 2 * 200 * 100 * 4);  // two views at a time
}

TEST(MemoryPlan, CountsMasksAsTheDeviceHasThem) {
    Scene scene = scene_of(9);
    TrainOptions o;
    const auto fixed = [&] { return estimate_memory(scene, o, 100, true); };
    const MemoryPlan without = fixed();
    for (View& view : scene.train) view.mask = ImageU8(200, 100, 1, 255);
    const MemoryPlan unused = fixed();
    EXPECT_EQ(unused.buffers.fixed, without.buffers.fixed);
    EXPECT_EQ(unused.host.fixed - without.host.fixed, 9 * 200 * 100);
    o.loss.photometric.masks = MaskUse::object;
    const MemoryPlan used = fixed();
    EXPECT_EQ(used.buffers.fixed - unused.buffers.fixed, 9 * 200 * 100 * 4);
    EXPECT_EQ(used.host.fixed, unused.host.fixed) << "made on the device";
}

/// Bytes of forward and backward for a view of `g`, less those without splats.
std::int64_t bytes_of_view(const char* name, const Gaussians<Cpu>& g) {
    const auto bytes = [&](const Gaussians<Cpu>& splats) {
        const std::int64_t before = memory_use(Cpu{}).current_bytes;
        const auto backbone = make_backbone<Cpu>(name, {});
        backbone->forward(splats, test::test_camera(160, 120), 3, Maps::color | kGeometryMaps);
        backbone->blend_backward(splats, {});
        return memory_use(Cpu{}).current_bytes - before;
    };
    return bytes(g) - bytes(test::random_gaussians(0, 1));
}

TEST(MemoryPlan, OfAViewCountsTheSplatsInView) {
    constexpr int kCount = 20000;
    for (const char* name : {"ewa", "rade", "surfel"})
        for (const double share : {0.0, 0.05, 0.3, 1.0}) {
            Gaussians<Cpu> g = test::random_gaussians(kCount, 3, 0.04);
            for (std::size_t i = 0; i < g.means.size(); ++i) {
                g.opacity_logits[i] = 2;
                const bool seen = static_cast<double>(i % 1000) < 1000 * share;
                g.means[i] = seen ? 0.7f * g.means[i] : Vec3f{0, 0, -1000};
            }
            const double bytes = static_cast<double>(bytes_of_view(name, g)) / kCount,
                         planned = static_cast<double>(view_bytes_per_splat(share));
            EXPECT_LE(bytes, planned) << name << ", share " << share;
            EXPECT_GT(bytes, 0.5 * planned) << name << ", share " << share;
        }
}

TEST(MemoryPlan, GoesByTheViewThatHasMostOfTheSplats) {
    Scene scene = scene_of(2);
    for (View& view : scene.train)
        view.camera.fx_px = view.camera.fy_px = 100, view.camera.cx_px = 100,
        view.camera.cy_px = 50;
    scene.train[1].camera.camera_from_world.t = {1000, 0, 0};
    TrainOptions o;
    o.densify.enabled = false;
    const auto per_splat = [&] { return estimate_memory(scene, o, 100, true).buffers.per_splat; };
    const std::int64_t all = per_splat();
    for (int i = 0; i < 1000; ++i)  // a fifth visible in one view, a tenth in the other
        scene.points.positions.push_back({i % 5 == 0    ? 0.0f
                                          : i % 10 == 1 ? -1000.0f
                                                        : 5000.0f,
                                          0, 2});
    EXPECT_EQ(per_splat(), all - view_bytes_per_splat(1) + view_bytes_per_splat(1.25 * 0.2 + 0.05));
    for (Vec3f& p : scene.points.positions) p = {0, 0, 2};
    EXPECT_EQ(per_splat(), all) << "no more than all";
    o.loss.multi_view_geometry.weight = 1;  // two views per step
    const std::int64_t two = per_splat();
    scene.points.positions.resize(1), scene.points.positions[0] = {5000, 0, 2};
    EXPECT_EQ(two - per_splat(), 2 * (view_bytes_per_splat(1) - view_bytes_per_splat(0.05)));
}

/// Bytes for a training of `splats` splats, on device and host.
MemoryLimits limits_for(const Scene& scene,
                        const TrainOptions& o,
                        std::int64_t splats,
                        std::int64_t more) {
    const MemoryPlan plan = estimate_memory(scene, o, splats, true);
    return {plan.buffers.at(splats) + more, std::int64_t{1} << 40};
}

/// With votes, without growth.
TrainOptions voting() {
    TrainOptions o;
    o.tv.enabled = true, o.densify.enabled = false;
    return o;
}

MachineInputs inputs(std::int64_t first, const MemoryLimits& limits) {
    MachineInputs in;
    in.cuda = true, in.limits = limits, in.first = first, in.expected = {first, "a test"};
    in.may_stream = in.may_compact = true;
    return in;
}

TEST(Machines, EachLevelOnEitherSideOfWhatItHolds) {
    const Scene scene = scene_of(9);
    const std::int64_t splats = 200000;  // much more than the photographs
    TrainOptions streamed = voting(), compact = voting(), both = voting();
    streamed.photo_bytes = both.photo_bytes = 1;
    compact.tv.lists = both.tv.lists = ListStorage::compact;
    const auto decided = [&](const TrainOptions& fits, std::int64_t more) {
        return decide_machines(scene, voting(),
                               inputs(splats, limits_for(scene, fits, splats, more)));
    };
    EXPECT_EQ(decided(voting(), 0).choice, "GPU");
    EXPECT_TRUE(decided(voting(), 0).settings.empty());
    EXPECT_EQ(decided(voting(), -1).choice, "photographs on the host");
    EXPECT_EQ(decided(voting(), -1).settings, (Settings{{"photo_bytes", "1"}}));
    EXPECT_EQ(decided(streamed, 0).choice, "photographs on the host");
    EXPECT_EQ(decided(streamed, -1).choice, "compact lists");
    EXPECT_EQ(decided(compact, 0).settings, (Settings{{"tv.lists", "compact"}}));
    EXPECT_EQ(decided(compact, -1).choice, "compact lists, photographs on the host");
    EXPECT_EQ(decided(both, 0).settings, (Settings{{"photo_bytes", "1"}, {"tv.lists", "compact"}}));
    const Decision none = decided(both, -1);
    EXPECT_EQ(none.choice, "blocks");
    EXPECT_NE(none.reason.find(
                  "199,999 fit; all in blocks: tvsgs-blocks split --scene ./made --blocks 2"),
              std::string::npos)
        << none.reason;
    EXPECT_GT(none.measured, none.threshold);
    EXPECT_LE(decided(voting(), 0).measured, decided(voting(), 0).threshold);
}

TEST(Machines, WhatTheUserSetsIsNotTheirs) {
    const Scene scene = scene_of(9);
    MachineInputs in = inputs(200000, limits_for(scene, voting(), 200000, -1));
    in.may_stream = false;
    EXPECT_EQ(decide_machines(scene, voting(), in).choice, "compact lists");
    in.may_compact = false;
    EXPECT_EQ(decide_machines(scene, voting(), in).choice, "blocks");
    in.may_stream = true;
    EXPECT_EQ(decide_machines(scene, voting(), in).choice, "photographs on the host");
    TrainOptions silent = voting();
    silent.tv.enabled = false;
    in = inputs(200000, limits_for(scene, silent, 200000, -100000000));
    EXPECT_EQ(decide_machines(scene, silent, in).choice, "blocks") << "no votes, no lists";
}

TEST(Machines, GrowthStopsWhereNoMoreFit) {
    const Scene scene = scene_of(9);
    TrainOptions grown = voting();
    grown.densify.enabled = true;
    MachineInputs in = inputs(1000, limits_for(scene, grown, 100000, 0));
    in.expected = {1000000, "a guess"};
    const Decision d = decide_machines(scene, grown, in);
    EXPECT_EQ(d.choice, "compact lists, photographs on the host") << "holds most";
    EXPECT_NE(d.reason.find("fit, where growth stops; all in blocks: tvsgs-blocks"),
              std::string::npos)
        << d.reason;
    EXPECT_NE(d.reason.find("for 1,000,000 splats (a guess)"), std::string::npos) << d.reason;
}

TEST(Machines, PhotographsThatCrowdAreOnTheHostAnyway) {
    const Scene scene = scene_of(9);  // 540,000 bytes
    MachineInputs in = inputs(10, {1080000, std::int64_t{1} << 40});
    TrainOptions o;
    o.densify.enabled = false;
    const auto streams = [&] { return !decide_machines(scene, o, in).settings.empty(); };
    in.limits.device = 4000000 + 1080000;
    EXPECT_FALSE(streams());
    in.limits.device = 1079999;  // photographs take more than half of it
    EXPECT_TRUE(streams());
    in.cuda = false;
    EXPECT_FALSE(streams()) << "there they are anyway";
}

TEST(Machines, OnACpuTheHostsMemoryCounts) {
    const Scene scene = scene_of(9);
    const MemoryPlan plan = estimate_memory(scene, voting(), 1000, false);
    MachineInputs in = inputs(1000, {plan.host.at(1000), plan.host.at(1000)});
    in.cuda = false;
    EXPECT_EQ(decide_machines(scene, voting(), in).choice, "CPU");
    EXPECT_NE(decide_machines(scene, voting(), in).reason.find("host memory"), std::string::npos);
    --in.limits.host, --in.limits.device;
    EXPECT_EQ(decide_machines(scene, voting(), in).choice, "compact lists");
    in.limits = {1000, 1000};
    const Decision images = decide_machines(scene, voting(), in);
    EXPECT_EQ(images.choice, "none");
    EXPECT_EQ(images.reason.find("tvsgs-blocks"), std::string::npos) << "images stay as large";
    // Also on a GPU, where host memory is short.
    in = inputs(1000, {std::int64_t{1} << 40, 1000});
    EXPECT_NE(decide_machines(scene, voting(), in).reason.find("host memory"), std::string::npos);
}

/// 2,394 splats of degree 3: a checkpoint of 1,972,655 bytes and a PLY of 595,261.
TEST(Disk, IsEstimatedAndRequired) {
    EXPECT_NEAR(double(disk_bytes(2394, 3, 1)), 1972655 + 595261, 30000);
    EXPECT_GT(disk_bytes(2394, 3, 2), disk_bytes(2394, 3, 1) + 1900000);
    EXPECT_LT(disk_bytes(2394, 0, 1), disk_bytes(2394, 3, 1) / 2);
    const std::string folder = testing::TempDir();
    require_disk(folder, 1);
    try {
        require_disk(folder, std::int64_t{1} << 60);
        FAIL() << "no disk has that much";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::io);
    }
}

TEST(Machines, ExpectedSplats) {
    const Scene scene = scene_of(9);  // 180,000 pixels
    TrainOptions o;
    o.densify.enabled = true, o.densify.max_per_pixel = 1;
    EXPECT_EQ(expected_splats(scene, o, 1000, false).count, 5000);
    EXPECT_NE(expected_splats(scene, o, 1000, false).source.find("guess"), std::string::npos);
    EXPECT_EQ(expected_splats(scene, o, 100000, false).count, 180000) << "a splat per pixel";
    o.densify.max_gaussians = 70000;
    EXPECT_EQ(expected_splats(scene, o, 1000, true).count, 70000);
    EXPECT_EQ(expected_splats(scene, o, 1000, false).count, 5000) << "a default is no wish";
    EXPECT_EQ(expected_splats(scene, o, 90000, true).count, 90000);
    o.densify.max_gaussians = 1000000;
    EXPECT_EQ(expected_splats(scene, o, 1000, true).count, 180000) << "which never is reached";
    o.iterations = o.densify.from;
    EXPECT_EQ(expected_splats(scene, o, 1000, true).count, 1000);
    o.iterations = 30000, o.densify.enabled = false;
    EXPECT_EQ(expected_splats(scene, o, 1000, true).count, 1000);
}

}  // namespace
}  // namespace tvsgs
