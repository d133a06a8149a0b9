// Camera refinement: frame, bounds, saved states, and trainings that correct noisy poses.
#include <cstring>

#include "core/error.h"
#include "training_scene.h"

namespace tvsgs {
namespace {

using test::Random;
using test::rendered_scene;

CameraOptions refining() {
    CameraOptions o;
    o.refine = true;
    return o;
}

std::vector<double> random_gradients(int views, Random& random) {
    std::vector<double> g(static_cast<std::size_t>(kCameraParameters * views));
    for (double& value : g) value = random.normal();
    return g;
}

/// The camera that sees the original world as `camera` sees the transformed world.
Camera seen_through(Camera camera, int direction, double by) {
    Rigid3d T{mat_cast<double>(camera.camera_from_world.R),
              vec_cast<double>(camera.camera_from_world.t)};
    Vec3d turn, shift;
    if (direction < 3) turn[direction] = by;
    if (direction >= 3 && direction < 6) shift[direction - 3] = by;
    T = T * inverse(rigid_exp(turn, shift));
    if (direction == 6) T.t = (1 + by) * T.t;
    camera.camera_from_world = {mat_cast<float>(T.R), vec_cast<float>(T.t)};
    return camera;
}

/// Image positions of the scene's points.
std::vector<Vec2f> images_of(const Scene& scene, const Camera& c) {
    std::vector<Vec2f> images;
    for (const Vec3f point : scene.points.positions) {
        const Vec3f q = c.camera_from_world * point;
        images.push_back({c.fx_px * q.x / q.z, c.fy_px * q.y / q.z});
    }
    return images;
}

/// The image motion by refinement is orthogonal to the image motion by similarities.
TEST(CameraRefinement, TheFrameStays) {
    const Scene scene = rendered_scene();
    CameraRefinement refined(scene, refining());
    Random random(3);
    for (int i = 0; i < 20; ++i) refined.step(random_gradients(3, random), 0.2);
    for (int direction = 0; direction < 7; ++direction) {
        double along = 0, by_step = 0, by_frame = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            const Camera& c = scene.train[i].camera;
            const auto was = images_of(scene, c), is = images_of(scene, refined.cameras()[i]),
                       frame = images_of(scene, seen_through(c, direction, 1e-2));
            for (std::size_t p = 0; p < was.size(); ++p) {
                const Vec2f a = is[p] - was[p], b = frame[p] - was[p];
                along += static_cast<double>(dot(a, b));
                by_step += static_cast<double>(dot(a, a)),
                    by_frame += static_cast<double>(dot(b, b));
            }
        }
        EXPECT_GT(by_step, 1);
        // Approximate, as the points are not an even grid of pixels.
        EXPECT_LT(std::abs(along), 0.15 * std::sqrt(by_step * by_frame)) << direction;
    }
}

TEST(CameraRefinement, OneViewAloneIsTheFrame) {
    Scene scene = rendered_scene();
    scene.train.resize(1);
    CameraRefinement refined(scene, refining());
    Random random(4);
    for (int i = 0; i < 5; ++i) refined.step(random_gradients(1, random), 1);
    const CameraMove move = refined.move(0);
    EXPECT_LT(move.turn_px + move.shift_px, 1e-6);
}

TEST(CameraRefinement, Bounds) {
    CameraOptions options = refining();
    options.bound_px = 0.7f;
    CameraRefinement refined(rendered_scene(), options);
    Random random(5);
    for (int i = 0; i < 10; ++i) refined.step(random_gradients(3, random), 100);
    double farthest = 0;
    for (int i = 0; i < 3; ++i) {
        const CameraMove move = refined.move(i);
        EXPECT_LE(std::max(move.turn_px, move.shift_px), 0.7 + 1e-6);
        EXPECT_NEAR(move.turn_deg, move.turn_px / (1.275 * 40) * 180 / M_PI, 1e-6);
        farthest = std::max({farthest, move.turn_px, move.shift_px});
    }
    EXPECT_GT(farthest, 0.69);
}

TEST(CameraRefinement, WhatIsNotFiniteMovesNothing) {
    const Scene scene = rendered_scene();
    CameraRefinement with(scene, refining()), without(scene, refining());
    std::vector<double> g(3 * kCameraParameters, 0);
    for (std::size_t k = kCameraParameters; k < g.size(); ++k) g[k] = static_cast<double>(k);
    without.step(g, 0.1);
    g[2] = NAN, g[5] = INFINITY;
    with.step(g, 0.1);
    EXPECT_EQ(with.numbers(), without.numbers());
    EXPECT_GT(with.move(1).turn_px, 0.01);
}

TEST(CameraRefinement, ThePriorPullsBack) {
    CameraOptions options = refining();
    options.prior = 1;
    CameraRefinement refined(rendered_scene(), options);
    Random random(6);
    for (int i = 0; i < 10; ++i) refined.step(random_gradients(3, random), 0.2);
    const double before = refined.move(1).turn_px + refined.move(1).shift_px;
    const std::vector<double> none(3 * kCameraParameters, 0);
    for (int i = 0; i < 200; ++i) refined.step(none, 0.02);
    EXPECT_LT(refined.move(1).turn_px + refined.move(1).shift_px, 0.3 * before);
}

TEST(CameraRefinement, RestoresAndRefusesOthers) {
    const Scene scene = rendered_scene();
    CameraRefinement one(scene, refining()), two(scene, refining());
    Random random(7);
    one.step(random_gradients(3, random), 0.1);
    two.restore(one.numbers(), 3 * kCameraParameters);
    const std::vector<double> g = random_gradients(3, random);
    one.step(g, 0.1), two.step(g, 0.1);
    EXPECT_EQ(one.numbers(), two.numbers());
    EXPECT_EQ(0, std::memcmp(one.cameras().data(), two.cameras().data(), 3 * sizeof(Camera)));
    EXPECT_THROW(two.restore({1, 2, 3}, 3 * kCameraParameters), Error);
    EXPECT_THROW(two.restore(one.numbers(), 4), Error);
    std::vector<double> broken = one.numbers();
    broken[3] = NAN;
    EXPECT_THROW(two.restore(broken, 3 * kCameraParameters), Error);
}

// Trainings.

struct Outcome {
    Gaussians<Cpu> splats;
    std::optional<CameraRefinement> cameras;
    std::vector<std::pair<int, SharedState>> saved;
};

template <class Device = Cpu>
Outcome run(const Scene& scene, const TrainOptions& options, const SharedState& start = {}) {
    Outcome outcome;
    TrainCallbacks callbacks;
    callbacks.on_cameras = [&](const CameraRefinement& c) { outcome.cameras = c; };
    callbacks.save_due = [](int done) { return done % 5 == 4; };
    callbacks.on_save = [&](int done, const SharedState& s) { outcome.saved.push_back({done, s}); };
    copy(train<Device>(scene, options, callbacks, {}, start), outcome.splats);
    return outcome;
}

bool same_bits(const Gaussians<Cpu>& a, const Gaussians<Cpu>& b) {
    bool same = true;
    for_each_array(
        [&](const SplatArray&, const auto& x, const auto& y) {
            same = same && x.size() == y.size() &&
                   std::memcmp(x.data(), y.data(), x.size() * sizeof(*x.data())) == 0;
        },
        a, b);
    return same;
}

/// Root mean square distance between the image points of true and refined cameras, px.
double pixels_off(const std::vector<View>& truth, const std::vector<Camera>& found) {
    double sum = 0, count = 0;
    for (std::size_t i = 0; i < truth.size(); ++i)
        for (int corner = 0; corner < 27; ++corner) {
            const Vec3f p{float(corner % 3) - 1, float(corner / 3 % 3) - 1, float(corner / 9) - 1};
            const auto at = [&](const Camera& c) {
                const Vec3f q = c.camera_from_world * p;
                return Vec2f{c.fx_px * q.x / q.z, c.fy_px * q.y / q.z};
            };
            const Vec2f d = at(truth[i].camera) - at(found[i]);
            sum += static_cast<double>(dot(d, d)), ++count;
        }
    return std::sqrt(sum / count);
}

std::vector<Camera> cameras_of(const Scene& scene) {
    std::vector<Camera> cameras;
    for (const View& view : scene.train) cameras.push_back(view.camera);
    return cameras;
}

/// Noise without a component along similarities, which no training can correct.
Scene with_noise(Scene scene, double px) {
    CameraRefinement noise(scene, refining());
    Random random(8);
    for (int i = 0; i < 4; ++i)
        noise.step(random_gradients(static_cast<int>(scene.train.size()), random), px / 3);
    for (std::size_t i = 0; i < scene.train.size(); ++i) scene.train[i].camera = noise.cameras()[i];
    return scene;
}

TrainOptions short_training(const char* backbone, int iterations) {
    TrainOptions o;
    o.iterations = iterations;
    o.backbone = backbone;
    o.model.sh_degree = 0;
    o.densify.enabled = false;
    o.cameras.refine = true;
    o.cameras.start = iterations / 6;
    o.cameras.rate = 0.08f;
    return o;
}

TEST(RefinedTraining, FindsNoisyCamerasAgain) {
    const Scene truth = rendered_scene(), noisy = with_noise(truth, 1);
    const double before = pixels_off(truth.train, cameras_of(noisy));
    ASSERT_GT(before, 0.5);
    for (const char* backbone : {"ewa", "rade", "surfel"}) {
        const Outcome outcome = run(noisy, short_training(backbone, 180));
        ASSERT_TRUE(outcome.cameras);
        EXPECT_LT(pixels_off(truth.train, outcome.cameras->cameras()), 0.6 * before) << backbone;
    }
}

TEST(RefinedTraining, WithoutStepsNothingChangesABit) {
    const Scene scene = rendered_scene();
    TrainOptions options = test::everything_on(35);
    options.densify.max_gaussians = 200;  // for a short test
    const Outcome off = run(scene, options);
    EXPECT_FALSE(off.cameras);
    for (const auto& [done, state] : off.saved) EXPECT_EQ(state->find("cameras.numbers"), nullptr);
    options.cameras.refine = true, options.cameras.start = 1, options.cameras.rate = 0;
    const Outcome still = run(scene, options);
    EXPECT_TRUE(same_bits(off.splats, still.splats));
    options.cameras.rate = 0.05f;
    EXPECT_FALSE(same_bits(off.splats, run(scene, options).splats));
}

/// Rounds have three iterations; states are saved within a round; growth changes splats.
template <class Device>
void resumes() {
    const Scene scene = with_noise(rendered_scene(), 1);
    TrainOptions options = test::everything_on(32);
    options.densify.max_gaussians = 200;
    options.cameras.refine = true;
    options.cameras.start = 5;
    const Outcome whole = run<Device>(scene, options);
    for (const auto& [done, state] : whole.saved) {
        const Outcome rest = run<Device>(scene, options, state);
        EXPECT_TRUE(same_bits(whole.splats, rest.splats)) << "from iteration " << done;
        EXPECT_EQ(whole.cameras->numbers(), rest.cameras->numbers());
    }
    options.cameras.refine = false;
    EXPECT_THROW(run<Device>(scene, options, whole.saved[5].second), Error)
        << "its splats go with other poses";
}
TEST(RefinedTraining, TheSameBitsFromAnyIteration) {
    resumes<Cpu>();
}
TEST(RefinedTrainingTwin, TheSameBitsFromAnyIteration) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) resumes<Cuda>();
}
TEST(RefinedTrainingTwin, MovesAsTheCpuDoes) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const Scene scene = with_noise(rendered_scene(), 1);
        const TrainOptions options = short_training("ewa", 60);
        const Outcome cpu = run<Cpu>(scene, options), cuda = run<Cuda>(scene, options);
        for (std::size_t k = 0; k < 18; ++k)
            EXPECT_NEAR(cpu.cameras->numbers()[k], cuda.cameras->numbers()[k], 0.02);
    }
}

TEST(RefinedTraining, RefusesWhatHasNoDerivatives) {
    TrainOptions options = short_training("ewa", 10);
    EXPECT_NO_THROW(check_cameras(options, true));
    EXPECT_THROW(check_cameras(options, false), Error);
    options.loss.photometric.weight = 0;
    options.loss.normal = {1, 1};
    EXPECT_THROW(run(rendered_scene(), options), Error);
    options.cameras.refine = false;
    EXPECT_NO_THROW(check_cameras(options, false));
}

TEST(Support, RefusesOptionsThatDoNotFit) {
    TrainOptions options;
    const BackboneTraits parts{.parts_colors = true};
    EXPECT_NO_THROW(check_support(options, {}));
    options.loss.photometric.geometry = 0;
    EXPECT_THROW(check_support(options, parts), Error) << "init.support is missing";
    EXPECT_NO_THROW(check_support(options, parts, true)) << "the plan may set it";
    options.init.support = true;
    EXPECT_NO_THROW(check_support(options, parts));
    EXPECT_THROW(check_support(options, {}), Error) << "the backbone cannot part the gradients";
    options.cameras.refine = true;
    EXPECT_THROW(check_support(options, parts), Error) << "cameras would get the share as well";
    options = {};
    options.lr.supported = 0.5f;
    EXPECT_THROW(check_support(options, parts), Error) << "init.support is missing";
}

}  // namespace
}  // namespace tvsgs
