// Saved states: a resumed training gives the same bits, and numbers that are not finite are found,
// reported and rolled back.
#include <algorithm>
#include <cstring>

#include "core/error.h"
#include "optim/views/device_views.h"
#include "training_scene.h"

namespace tvsgs {
namespace {

using test::rendered_scene;

TrainOptions everything_on(int iterations) {
    TrainOptions options = test::everything_on(iterations);
    options.densify.max_gaussians = 250;  // for short tests
    options.densify.growth_in_gaps_only = 0.5f;
    return options;
}

struct Saved {
    int done;
    SharedState state;
};

struct Outcome {
    Gaussians<Cpu> gaussians;
    std::vector<Saved> saved;
    std::vector<std::string> rollbacks;
    std::string error;
    int end = -1;
};

struct Plan {
    std::function<bool(int)> save;
    SharedState start;
    InjectedFault fault;
    int stop_at = -1;
};

template <class Device>
Outcome run(const Scene& scene, const TrainOptions& options, const Plan& plan = {}) {
    Outcome result;
    int polls = plan.start ? iterations_done(*plan.start) : 0;
    TrainCallbacks callbacks;
    callbacks.save_due = plan.save;
    callbacks.on_save = [&](int done, const SharedState& s) { result.saved.push_back({done, s}); };
    callbacks.on_rollback = [&](int, const std::string& what) { result.rollbacks.push_back(what); };
    callbacks.on_end = [&](int done) { result.end = done; };
    callbacks.stop_requested = [&] { return polls++ == plan.stop_at; };
    callbacks.injected_fault = plan.fault;
    try {
        copy(train<Device>(scene, options, callbacks, {}, plan.start), result.gaussians);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::numerical) << error.what();
        result.error = error.what();
    }
    return result;
}

bool same_bits(const State& a, const State& b) {
    for (std::size_t i = 0; i < a.arrays.size(); ++i) {
        const auto &p = a.arrays[i].bytes, &q = b.arrays[i].bytes;
        if (p.size() != q.size() || std::memcmp(p.data(), q.data(), p.size()) != 0) return false;
    }
    return a.arrays.size() == b.arrays.size();
}
bool same_bits(const Gaussians<Cpu>& a, const Gaussians<Cpu>& b) {
    State x, y;
    for (auto [g, state] : {std::pair{&a, &x}, {&b, &y}}) {
        StateVisitor<Cpu> visit(*state);
        visit_state(visit, "", const_cast<Gaussians<Cpu>&>(*g));
    }
    return same_bits(x, y);
}

auto after(int done) {
    return [done](int now) { return now == done; };
}

/// Growth at 10, 20, ...; trims at 20, 40, ...; voting every 10 and neighbour searches every 20
/// iterations; exposure from 11 on; resets at 30, 60, ...
template <class Device>
void resumes_from_anywhere() {
    const Scene scene = rendered_scene();
    const TrainOptions options = everything_on(47);
    const Outcome whole = run<Device>(scene, options, {[](int) { return true; }, {}, {}});
    ASSERT_EQ(whole.saved.size(), 47u);  // after 0 to 46
    EXPECT_TRUE(same_bits(whole.gaussians, run<Device>(scene, options).gaussians))
        << "saving changes nothing";
    for (const int done : {0, 1, 9, 10, 11, 19, 20, 21, 30, 31, 34, 40, 46}) {
        const Saved& from = whole.saved[static_cast<std::size_t>(done)];
        ASSERT_EQ(iterations_done(*from.state), done);
        const Outcome rest = run<Device>(scene, options, {{}, from.state, {}});
        EXPECT_EQ(rest.end, 47);
        EXPECT_TRUE(same_bits(whole.gaussians, rest.gaussians)) << "from iteration " << done;
    }
}

TEST(Resume, TheSameBitsFromAnyIteration) {
    resumes_from_anywhere<Cpu>();
}

/// Growth, trims, resets, voting and checks of the guard depend only on the seed.
template <class Device>
void repeats_itself() {
    const Scene scene = rendered_scene();
    TrainOptions options = everything_on(300);
    // For a short test.
    options.loss.multi_view_ncc.weight = options.loss.multi_view_geometry.weight = 0;
    const Outcome once = run<Device>(scene, options), twice = run<Device>(scene, options);
    EXPECT_EQ(once.end, 300);
    EXPECT_TRUE(same_bits(once.gaussians, twice.gaussians));
}

TEST(Repeat, ThreeHundredIterationsGiveTheSameBits) {
    repeats_itself<Cpu>();
}

/// The device holds only the photographs of two iterations.
template <class Device>
void photographs_from_the_host_change_nothing() {
    Scene scene = rendered_scene();
    for (std::size_t i = 0; i < 4; ++i) {  // six views fit: with these there are seven
        View view = scene.train[i % 3];
        for (std::size_t p = 0; p < view.photo.pixels.size(); ++p)
            view.photo.pixels[p] = static_cast<std::uint8_t>(view.photo.pixels[p] / 2 + 20 * i);
        scene.train.push_back(std::move(view));
    }
    TrainOptions options = everything_on(60);
    ASSERT_TRUE(DeviceViews<Cpu>(scene.train, needs_of(options.loss), 0).all_resident());
    const Outcome all = run<Device>(scene, options);
    options.photo_bytes = 1;
    ASSERT_FALSE(DeviceViews<Cpu>(scene.train, needs_of(options.loss), 1).all_resident());
    const Outcome some = run<Device>(scene, options);
    EXPECT_EQ(some.end, 60);
    EXPECT_TRUE(same_bits(all.gaussians, some.gaussians));
}

TEST(Repeat, PhotographsFromTheHostChangeNothing) {
    photographs_from_the_host_change_nothing<Cpu>();
}

TEST(Resume, TwiceSixtyAre120) {
    const Scene scene = rendered_scene();
    TrainOptions options = everything_on(120);
    const Outcome whole = run<Cpu>(scene, options);
    options.iterations = 60;
    const Outcome first = run<Cpu>(scene, options, {after(59), {}, {}});
    ASSERT_EQ(first.saved.size(), 1u);
    options.iterations = 120;
    const Outcome second = run<Cpu>(scene, options, {{}, first.saved[0].state, {}});
    EXPECT_TRUE(same_bits(whole.gaussians, second.gaussians));
    EXPECT_FALSE(same_bits(whole.gaussians, first.gaussians));
}

TEST(Resume, AStoppedTrainingGoesOn) {
    const Scene scene = rendered_scene();
    const TrainOptions options = everything_on(40);
    Plan plan;
    plan.stop_at = 23;
    const Outcome stopped = run<Cpu>(scene, options, plan);
    EXPECT_EQ(stopped.end, 23);
    ASSERT_EQ(stopped.saved.size(), 1u);
    const Outcome rest = run<Cpu>(scene, options, {{}, stopped.saved[0].state, {}});
    EXPECT_TRUE(same_bits(run<Cpu>(scene, options).gaussians, rest.gaussians));
}

TEST(Resume, AnotherDegreeIsRefused) {
    const Scene scene = rendered_scene();
    TrainOptions options = everything_on(4);
    const Outcome first = run<Cpu>(scene, options, {after(2), {}, {}});
    options.model.sh_degree = 1;
    try {
        train<Cpu>(scene, options, {}, {}, first.saved.at(0).state);
        ADD_FAILURE() << "no error";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::usage);
        EXPECT_NE(std::string(error.what()).find("model.sh_degree"), std::string::npos);
    }
}

/// States of a faulty writer with a valid checksum.
TEST(Resume, StatesThatDoNotFitAreRefused) {
    const Scene scene = rendered_scene();
    const TrainOptions options = everything_on(15);
    const Outcome first = run<Cpu>(scene, options, {after(13), {}, {}});
    const State& good = *first.saved.at(0).state;
    for (std::size_t spoilt = 0; spoilt < good.arrays.size(); ++spoilt)
        for (const bool missing : {false, true}) {
            auto bad = std::make_shared<State>();
            for (std::size_t i = 0; i < good.arrays.size(); ++i) {
                const StateArray& from = good.arrays[i];
                if (i == spoilt && missing) continue;
                const std::size_t less = i == spoilt ? 1 : 0;
                ASSERT_GT(from.count(), 0u) << from.name;
                StateArray& to =
                    bad->add(from.name, from.element_bytes, from.count() - less, from.real);
                std::copy_n(from.bytes.data(), to.bytes.size(), to.bytes.data());
            }
            if (good.arrays[spoilt].name == "exposure") continue;  // exposures then start again
            EXPECT_THROW(train<Cpu>(scene, options, {}, {}, bad), Error)
                << good.arrays[spoilt].name << (missing ? " missing" : " short");
        }
}

struct GroupCase {
    ParameterGroup group;
    const char* says;
};

template <class Device>
void parameters_are_watched() {
    const Scene scene = rendered_scene();
    TrainOptions options = everything_on(32);
    options.loss.multi_view_ncc.weight = 0;
    for (const GroupCase c : {GroupCase{ParameterGroup::means, "the centre of splat 7 is"},
                              {ParameterGroup::scales, "the scale of splat 7 is"},
                              {ParameterGroup::rotations, "the rotation of splat 7 is"},
                              {ParameterGroup::opacities, "the opacity of splat 7 is"},
                              {ParameterGroup::sh_dc, "the base colour of splat 7 is"},
                              {ParameterGroup::sh_rest, "the SH coefficients of splat 7"}}) {
        Plan plan{after(12), {}, {}};
        plan.fault = {24, -1, c.group, 7, 1};
        const Outcome once = run<Device>(scene, options, plan);
        EXPECT_EQ(once.error, "");
        ASSERT_EQ(once.rollbacks.size(), 1u) << c.says;
        EXPECT_NE(once.rollbacks[0].find(c.says), std::string::npos) << once.rollbacks[0];
        EXPECT_NE(once.rollbacks[0].find(rate_key(c.group)), std::string::npos)
            << once.rollbacks[0];
        EXPECT_NE(once.rollbacks[0].find("back to iteration 12,"), std::string::npos);
        EXPECT_EQ(once.end, 32);
        State end;
        StateVisitor<Cpu> visit(end);
        visit_state(visit, "", const_cast<Gaussians<Cpu>&>(once.gaussians));
        EXPECT_FALSE(find_not_finite(end));

        plan.fault.times = 2;
        const Outcome twice = run<Device>(scene, options, plan);
        EXPECT_NE(twice.error.find(c.says), std::string::npos) << twice.error;
        EXPECT_NE(twice.error.find("resume from iteration 12"), std::string::npos) << twice.error;
        ASSERT_FALSE(twice.saved.empty());
        EXPECT_EQ(twice.saved.back().done, 12);
        for (const Saved& saved : twice.saved) EXPECT_FALSE(find_not_finite(*saved.state));
    }
}

template <class Device>
void losses_are_watched() {
    const Scene scene = rendered_scene();
    const TrainOptions options = everything_on(17);
    const char* const terms[] = {"photometric",    "flatten",   "normal",     "multi_view_geometry",
                                 "multi_view_ncc", "tv_normal", "tv_position"};
    for (int term = 0; term < 7; ++term) {
        Plan plan{after(9), {}, {}};
        plan.fault.step = 12, plan.fault.term = term;
        const Outcome once = run<Device>(scene, options, plan);
        ASSERT_EQ(once.rollbacks.size(), 1u);
        const std::string says =
            std::string("iteration 12: the loss term '") + terms[term] + "' is not finite in view";
        EXPECT_EQ(once.rollbacks[0].find(says), 0u) << once.rollbacks[0];
        EXPECT_NE(once.rollbacks[0].find("back to iteration 9, with lr.position_start, lr.scale, "),
                  std::string::npos)
            << once.rollbacks[0];
        EXPECT_EQ(once.end, 17);
        plan.fault.times = 2;
        plan.save = {};  // nothing was saved: training restarts, and the start is handed over
        const Outcome twice = run<Device>(scene, options, plan);
        EXPECT_EQ(twice.error.find(says), 0u) << twice.error;
        ASSERT_EQ(twice.saved.size(), 1u);
        EXPECT_EQ(twice.saved[0].done, 0);
    }
}

TEST(Guard, ParametersAreWatched) {
    parameters_are_watched<Cpu>();
}

TEST(Guard, LossesAreWatched) {
    losses_are_watched<Cpu>();
}

TEST(Guard, ARollbackIsTheSameRunAtALowerRate) {
    // From iteration 12 on the rate of the opacities is a tenth; otherwise the fault has no effect.
    const Scene scene = rendered_scene();
    TrainOptions options = everything_on(30);
    options.loss.multi_view_ncc.weight = 0;
    Plan plan{after(12), {}, {}};
    const Outcome first = run<Cpu>(scene, options, plan);
    plan.fault = {24, -1, ParameterGroup::opacities, 0, 1};
    const Outcome rolled = run<Cpu>(scene, options, plan);
    options.lr.opacity *= 0.1f;
    const Outcome lower = run<Cpu>(scene, options, {{}, first.saved.at(0).state, {}});
    EXPECT_TRUE(same_bits(rolled.gaussians, lower.gaussians));
}

TEST(Guard, ASceneThatIsNotFiniteIsRefused) {
    Scene scene = rendered_scene();
    scene.points.colors.assign(scene.points.positions.size(), Vec3f{1, 1, INFINITY});
    const Outcome r = run<Cpu>(scene, everything_on(3));
    EXPECT_NE(r.error.find("the first splats: iteration 0: the base colour of splat 0"),
              std::string::npos)
        << r.error;
    EXPECT_TRUE(r.saved.empty());
}

TEST(ResumeTwins, Cuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) resumes_from_anywhere<Cuda>();
}
TEST(RepeatTwins, CudaThreeHundredIterations) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) repeats_itself<Cuda>();
}
TEST(RepeatTwins, CudaPhotographsFromTheHostChangeNothing) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) photographs_from_the_host_change_nothing<Cuda>();
}
TEST(GuardTwins, CudaParameters) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) parameters_are_watched<Cuda>();
}
TEST(GuardTwins, CudaLosses) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) losses_are_watched<Cuda>();
}

}  // namespace
}  // namespace tvsgs
