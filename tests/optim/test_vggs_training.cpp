// Trainings with priors: they act, other views are rendered only where a target is due, and neither
// checkpoints nor photographs that come from the host change a bit.
#include <cmath>
#include <cstring>
#include <map>

#include "core/scene/prior_maps.h"
#include "optim/loop/iteration.h"
#include "optim/views/device_views.h"
#include "training_scene.h"

namespace tvsgs {
namespace {

/// Seven views; their priors are the depth that the first points show.
Scene scene_with_priors() {
    Scene scene = test::rendered_scene();
    const Gaussians<Cpu> truth = test::random_gaussians(150, 21, 0.15, 0);
    auto backbone = make_backbone<Cpu>("ewa", {});
    for (std::size_t i = 0; i < 4; ++i) scene.train.push_back(scene.train[i % 3]);
    for (View& view : scene.train) {
        const auto& images = backbone->forward(truth, view.camera, 0, kGeometryMaps);
        const int w = view.camera.width_px, h = view.camera.height_px;
        ViewMap order{"depth_order", w, h, 1, {}}, depth{"depth", w, h, 1, {}},
            normal{"normal", w, h, 3, {}};
        for (std::size_t p = 0; p < images.depth.size(); ++p) {
            const float d = images.depth[p];
            depth.values.push_back(d);
            order.values.push_back(d > 0 ? (d - 3) / 2 : std::nanf(""));
            normal.values.insert(normal.values.end(), {0, 0, -1});
        }
        for (ViewMap* map : {&order, &depth, &normal}) view.maps.push_back(std::move(*map));
    }
    scene.train[6].maps.clear();  // one came without
    return scene;
}

TrainOptions with_priors(int iterations) {
    TrainOptions o;
    o.iterations = iterations;
    o.densify.from = 10, o.densify.every = 10, o.densify.max_gaussians = 250;
    o.loss.multi_view.max_distance = 3;
    o.loss.relative_depth = {{0.1f, 2}};
    o.loss.prior_normal = {{0.01f, 3}};
    o.loss.prior_depth = {{0.1f, 4}, 0.1f, 30};
    o.loss.anchored_depth = {{0.1f, 5}, 0, 0, 15};
    return o;
}

struct Run {
    Gaussians<Cpu> gaussians;
    std::map<int, SharedState> saved;
    std::map<std::string, double> most;  // of each term
};

template <class Device>
Run run(const Scene& scene, const TrainOptions& options, bool save, SharedState start = {}) {
    Run result;
    TrainCallbacks callbacks;
    callbacks.save_due = [save](int) { return save; };
    callbacks.on_save = [&](int done, const SharedState& s) { result.saved[done] = s; };
    callbacks.report_due = [](int) { return true; };
    callbacks.on_report = [&](const TrainReport& report) {
        for (const auto& [name, value] : report.terms)
            result.most[name] = std::max(result.most[name], value);
    };
    copy(train<Device>(scene, options, callbacks, {}, start), result.gaussians);
    return result;
}

bool same_bits(const Run& a, const Run& b) {
    bool same = a.gaussians.size() == b.gaussians.size();
    for_each_array(
        [&](const SplatArray&, const auto& x, const auto& y) {
            same = same && x.size() == y.size() &&
                   std::memcmp(x.data(), y.data(), x.size() * sizeof(x[0])) == 0;
        },
        a.gaussians, b.gaussians);
    return same;
}

template <class Device>
void goes_on_with_the_same_bits() {
    const Scene scene = scene_with_priors();
    const TrainOptions options = with_priors(40);
    const Run whole = run<Device>(scene, options, true);
    for (const char* term : {"relative_depth", "prior_normal", "prior_depth", "anchored_depth"})
        EXPECT_GT(whole.most.at(term), 1e-6) << term;
    for (const int done : {0, 4, 5, 9, 19, 20, 21, 31}) {
        const Run rest = run<Device>(scene, options, false, whole.saved.at(done));
        EXPECT_TRUE(same_bits(whole, rest)) << "from iteration " << done;
    }
    TrainOptions streamed = options;
    streamed.photo_bytes = 1;
    ASSERT_FALSE(DeviceViews<Cpu>(scene.train, needs_of(options.loss), 1).all_resident());
    EXPECT_TRUE(same_bits(whole, run<Device>(scene, streamed, false)));
    TrainOptions without = options;
    without.loss.anchored_depth.weight = 0;
    EXPECT_FALSE(same_bits(whole, run<Device>(scene, without, false)));
}

TEST(TrainingWithPriors, GoesOnWithTheSameBits) {
    goes_on_with_the_same_bits<Cpu>();
}

TEST(TrainingWithPriors, GoesOnWithTheSameBitsOnCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) goes_on_with_the_same_bits<Cuda>();
}

TEST(TrainingWithPriors, OtherViewsAreWantedWhereATargetIsDue) {
    const TrainOptions o = with_priors(40);
    const auto losses = make_losses<Cpu>(o.loss, {.views = 7});
    EXPECT_EQ(needs_at(losses, 4, 0, true).neighbour_views, 0);
    EXPECT_EQ(needs_at(losses, 5, 0, true).rendered_views, 1);
    EXPECT_TRUE(has(needs_at(losses, 5, 0, true).maps, Maps::normal));
    EXPECT_TRUE(needs_at(losses, 5, 0, true).grey);
    // A view that is paired with none.
    EXPECT_EQ(needs_at(losses, 5, 0, false).neighbour_views, 0);
}

}  // namespace
}  // namespace tvsgs
