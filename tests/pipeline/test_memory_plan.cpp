// What terms read and keep for each view is in the estimate of a training's memory.
#include <gtest/gtest.h>

#include "optim/loss.h"
#include "pipeline/memory_plan.h"

namespace tvsgs {
namespace {

Scene scene_of(int views) {
    Scene scene;
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
    keeps.loss.anchored_depth.weight = 1;  // which looks at another view, too
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
    EXPECT_EQ(used.host.fixed - unused.host.fixed, 9 * 200 * 100 * 4);
}

}  // namespace
}  // namespace tvsgs
