// Whole trainings on scenes and settings at which trainers blow up: they end finite, or with the
// error that docs/develop/reliability.md names.
#include <cmath>

#include "core/error.h"
#include "optim/loop/train.h"
#include "optim/training_scene.h"

namespace tvsgs {
namespace {

using test::everything_on;
using test::rendered_scene;

constexpr int kIterations = 60;  // votes, growth, trims and a reset are among them

struct Outcome {
    Gaussians<Cpu> splats;
    std::vector<double> losses, photometric;
    int rollbacks = 0;
};

Outcome run(const Scene& scene, const TrainOptions& options) {
    Outcome outcome;
    TrainCallbacks callbacks;
    callbacks.report_due = [](int) { return true; };
    callbacks.on_report = [&](const TrainReport& r) {
        outcome.losses.push_back(r.loss);
        for (const auto& [name, value] : r.terms)
            if (std::string(name) == "photometric") outcome.photometric.push_back(value);
    };
    callbacks.on_rollback = [&](int, const std::string&) { ++outcome.rollbacks; };
    outcome.splats = train<Cpu>(scene, options, callbacks);
    return outcome;
}

template <class T>
bool all_finite(const Buffer<T, Cpu>& values) {
    const float* const at = reinterpret_cast<const float*>(values.data());
    for (std::size_t i = 0; i < values.size() * (sizeof(T) / sizeof(float)); ++i)
        if (!std::isfinite(at[i])) return false;
    return true;
}

void expect_finite(const Outcome& o) {
    EXPECT_GT(o.splats.size(), 0);
    EXPECT_TRUE(all_finite(o.splats.means) && all_finite(o.splats.log_scales) &&
                all_finite(o.splats.quats) && all_finite(o.splats.opacity_logits) &&
                all_finite(o.splats.sh));
    for (const double loss : o.losses) EXPECT_TRUE(std::isfinite(loss));
}

TEST(HardScenes, OneView) {
    Scene scene = rendered_scene();
    scene.train.resize(1);
    TrainOptions options = everything_on(kIterations);
    options.densify.opacity_reset_every = 1000;  // would hide that the loss falls
    const Outcome o = run(scene, options);
    expect_finite(o);
    EXPECT_LT(o.losses[24], o.losses[0]);
}

TEST(HardScenes, PhotographsOfOneColour) {
    for (const int level : {0, 128, 255}) {
        Scene scene = rendered_scene();
        for (View& view : scene.train)
            for (auto& value : view.photo.pixels) value = static_cast<std::uint8_t>(level);
        expect_finite(run(scene, everything_on(kIterations)));
    }
}

TEST(HardScenes, ViewsThatSeeNothing) {
    Scene scene = rendered_scene();
    // The first one turns its back on the splats, the second is among them.
    scene.train[0].camera.camera_from_world.R = {{{-1, 0, 0}, {0, 1, 0}, {0, 0, -1}}};
    scene.train[0].camera.camera_from_world.t = {0, 0, -4};
    scene.train[1].camera.camera_from_world.t = {0, 0, 0};
    expect_finite(run(scene, everything_on(kIterations)));
}

TEST(HardScenes, CoincidentAndCollinearPoints) {
    Scene scene = rendered_scene();
    std::vector<Vec3f>& points = scene.points.positions;
    for (std::size_t i = 0; i < points.size(); ++i)
        points[i] = i % 2 ? Vec3f{0.1f, 0.2f, 0.1f}
                          : Vec3f{-0.9f + 0.012f * static_cast<float>(i), 0.1f, 0};
    expect_finite(run(scene, everything_on(kIterations)));
}

TEST(HardScenes, APointFarFromTheRest) {
    Scene scene = rendered_scene();
    scene.points.positions[0] = {3e4f, -2e4f, 1e4f};  // its splat is as large as that is far
    expect_finite(run(scene, everything_on(kIterations)));
}

TEST(HardScenes, ScenesOfAnySize) {
    const auto at_size = [](float size) {
        Scene scene = rendered_scene();
        for (View& view : scene.train) {
            Vec3f& t = view.camera.camera_from_world.t;
            t = size * t;
        }
        for (Vec3f& p : scene.points.positions) p = size * p;
        scene.extent *= size;
        TrainOptions options = everything_on(kIterations);
        options.render.near *= size;  // world units, as the multi-view distances
        options.loss.multi_view.max_distance *= size;
        options.loss.flatten.weight /= size;
        return run(scene, options);
    };
    const Outcome usual = at_size(1);
    for (const float size : {1e-4f, 1e-2f, 1e4f}) {
        const Outcome o = at_size(size);
        expect_finite(o);
        // What the first step sees is the same picture; from then on roundings grow.
        EXPECT_NEAR(o.photometric[0], usual.photometric[0], 1e-4) << size;
        EXPECT_LT(o.photometric.back(), 1) << size;
    }
}

/// A hundred times the usual rates: finite, after one rollback at most, or exit code 7. No silent
/// garbage.
TEST(HardScenes, LearningRatesAHundredTimesTooHigh) {
    TrainOptions options = everything_on(kIterations);
    AdamOptions& lr = options.lr;
    for (float* rate : {&lr.position_start, &lr.position_end, &lr.sh_dc, &lr.sh_rest, &lr.opacity,
                        &lr.scale, &lr.rotation})
        *rate *= 100;
    try {
        const Outcome o = run(rendered_scene(), options);
        expect_finite(o);
        EXPECT_LE(o.rollbacks, 1);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::numerical) << error.what();
    }
}

}  // namespace
}  // namespace tvsgs
