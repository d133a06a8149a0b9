// Trainings with the backbone `rade`: they learn, keep their filter through growth, resume from any
// state with the same bits, and agree on both devices.
#include <cstring>

#include "training_scene.h"

namespace tvsgs {
namespace {

/// Growth by quantile, resets, votes and normals, all within 50 iterations.
TrainOptions all_of_it(int iterations) {
    TrainOptions o;
    o.iterations = iterations;
    o.backbone = "rade";
    o.loss.normal = {0.015f, 5};
    o.loss.tv_normal.weight = 0.05f;
    o.loss.tv_position.weight = 0.05f;
    o.tv.k = 20;
    o.tv.refresh_every = 20;
    o.model.sh_every = 10;
    o.densify.rule = GrowthRule::quantile;
    o.densify.from = 10;
    o.densify.every = 10;
    o.densify.trim_min_views = 0;
    o.densify.opacity_reset_every = 30;
    o.densify.max_gaussians = 250;
    return o;
}

struct Outcome {
    Gaussians<Cpu> splats;
    std::vector<double> photometric;
    std::vector<std::pair<int, SharedState>> saved;
};

template <class Device>
Outcome run(const TrainOptions& options, const SharedState& start = {}) {
    static const Scene scene = test::rendered_scene();
    Outcome outcome;
    TrainCallbacks callbacks;
    callbacks.report_due = [](int) { return true; };
    callbacks.on_report = [&](const TrainReport& r) {
        for (const auto& [name, value] : r.terms)
            if (std::string(name) == "photometric") outcome.photometric.push_back(value);
    };
    callbacks.save_due = [](int done) { return done % 7 == 3; };
    callbacks.on_save = [&](int done, const SharedState& s) { outcome.saved.push_back({done, s}); };
    copy(train<Device>(scene, options, callbacks, {}, start), outcome.splats);
    return outcome;
}

bool same_bits(Gaussians<Cpu>& a, Gaussians<Cpu>& b) {
    bool same = true;
    for_each_array(
        [&](const SplatArray&, auto& x, auto& y) {
            same = same && x.size() == y.size() &&
                   std::memcmp(x.data(), y.data(), x.size() * sizeof(*x.data())) == 0;
        },
        a, b);
    return same;
}

TEST(TrainRade, SixtyIterationsLowerTheLoss) {
    TrainOptions options;
    options.iterations = 60;
    options.backbone = "rade";
    options.tv.enabled = false;
    const Outcome o = run<Cpu>(options);
    const auto of_round = [&](std::size_t first) {
        return o.photometric[first] + o.photometric[first + 1] + o.photometric[first + 2];
    };
    EXPECT_LT(of_round(57), 0.75 * of_round(0));
}

TEST(TrainRade, SplatsKeepAFilterOfTheirOwn) {
    const Outcome o = run<Cpu>(all_of_it(45));
    ASSERT_GT(o.splats.size(), 150);
    ASSERT_EQ(o.splats.filter.size(), o.splats.means.size());
    // The last change was at 40: the filter belongs to the splats' positions then.
    Gaussians<Cpu> now;
    copy(o.splats, now);
    std::vector<Camera> cameras;
    for (const View& view : test::rendered_scene().train) cameras.push_back(view.camera);
    make_backbone<Cpu>("rade", {})->prepare(0, true, cameras, now);
    for (std::size_t i = 0; i < now.means.size(); ++i) {
        EXPECT_GT(o.splats.filter[i], 0);
        EXPECT_NEAR(o.splats.filter[i], now.filter[i], 0.2f * now.filter[i]) << i;
        ASSERT_TRUE(is_finite(o.splats.means[i]) && is_finite(o.splats.log_scales[i]));
    }
}

template <class Device>
void resumes_with_the_same_bits() {
    Outcome whole = run<Device>(all_of_it(45));
    ASSERT_EQ(whole.saved.size(), 6u);
    for (const auto& [done, state] : whole.saved) {
        Outcome rest = run<Device>(all_of_it(45), state);
        EXPECT_TRUE(same_bits(whole.splats, rest.splats)) << "from iteration " << done;
    }
}

TEST(TrainRade, GoesOnWithTheSameBits) {
    resumes_with_the_same_bits<Cpu>();
}

TEST(TrainRadeTwins, GoesOnWithTheSameBits) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) resumes_with_the_same_bits<Cuda>();
}

/// Rounding errors grow with every step; until the first growth they are small.
TEST(TrainRadeTwins, CpuAgainstCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const Outcome a = run<Cpu>(all_of_it(19)), b = run<Cuda>(all_of_it(19));
        ASSERT_EQ(a.photometric.size(), b.photometric.size());
        for (std::size_t i = 0; i < a.photometric.size(); ++i)
            EXPECT_NEAR(a.photometric[i], b.photometric[i], 1e-2 * a.photometric[i]) << i;
        EXPECT_EQ(a.splats.size(), b.splats.size());
    }
}

}  // namespace
}  // namespace tvsgs
