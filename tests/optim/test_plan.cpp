// The plan: what it measures, and what it decides on either side of each threshold.
#include <gtest/gtest.h>

#include <set>

#include "core/error.h"
#include "io/config.h"
#include "optim/plan.h"
#include "optim/schedule.h"
#include "optim/time_budget.h"
#include "training_scene.h"

namespace tvsgs {
namespace {

constexpr double kDegree = 3.14159265358979 / 180;

/// Cameras on an arc around a small patch that faces them, `step_deg` apart and 5 units away, whose
/// photographs are of one grey; `points` points on the patch, seen by all.
Scene patch_scene(int views, double step_deg, int points) {
    Scene scene;
    for (int v = 0; v < views; ++v) {
        View view;
        const double angle = (v - 0.5 * (views - 1)) * step_deg * kDegree;
        const auto c = static_cast<float>(std::cos(angle)), s = static_cast<float>(std::sin(angle));
        view.camera = {100, 80, 200, 200, 50, 40, {}};
        // The axes of a camera at (5 s, 0, -5 c) that looks at the origin.
        view.camera.camera_from_world.R = {{{c, 0, s}, {0, 1, 0}, {-s, 0, c}}};
        view.camera.camera_from_world.t = {0, 0, 5};
        view.photo = ImageU8(100, 80, 3, 100);
        view.name = std::to_string(v);
        scene.train.push_back(std::move(view));
    }
    for (int i = 0; i < points; ++i) {
        const float x = static_cast<float>(i % 40) / 40 - 0.5f,
                    y = static_cast<float>(i / 40 % 40) / 40 - 0.5f;
        scene.points.positions.push_back({x, y, 1e-4f * static_cast<float>(i / 1600)});
    }
    scene.extent = 5;
    return scene;
}

std::string choice(const std::vector<Decision>& plan, const std::string& name) {
    for (const Decision& decision : plan)
        if (decision.name == name) return decision.choice;
    return "no such decision";
}

SceneLook look_of(const Scene& scene) {
    return look_at(scene, NeighbourOptions{});
}

TEST(PlanLook, MeasuresWhatTheSceneWasMadeWith) {
    const SceneLook look = look_of(patch_scene(5, 6, 1600));
    EXPECT_EQ(look.views, 5);
    EXPECT_NEAR(look.points_per_pixel, 1600 / 8000., 1e-12) << "all points lie in all views";
    EXPECT_NEAR(look.views_per_point, 5, 1e-12);
    // The outermost cameras are 24 degrees apart as the origin sees them; points beside it, by up
    // to 0.7 of 5 units, see them under angles that differ by some percent.
    EXPECT_NEAR(look.direction_spread_deg, 24, 0.5);
    EXPECT_EQ(look.views_with_neighbour, 1);
    EXPECT_EQ(look.exposure_drift, 0);
}

TEST(PlanLook, WithoutPointsNothingIsMadeUp) {
    const SceneLook look = look_of(patch_scene(3, 10, 0));
    EXPECT_EQ(look.points_per_pixel, 0);
    EXPECT_TRUE(std::isnan(look.direction_spread_deg));
    EXPECT_TRUE(std::isnan(look.exposure_drift));
    const auto plan = plan_training(look, TrainOptions{}, 15000);
    EXPECT_EQ(choice(plan, "exposure"), "off");
    EXPECT_EQ(choice(plan, "densify"), "on");
}

TEST(Plan, SettingsByTheNumberOfViews) {
    EXPECT_EQ(plan_settings(24).choice, "sparse");
    EXPECT_EQ(plan_settings(25).choice, "dense");
}

TEST(Plan, CloudAndDensificationByItsDensity) {
    for (const bool covering : {false, true}) {
        // On 8,000 pixels, 799 and 801 points: just below and above a tenth.
        const SceneLook look = look_of(patch_scene(3, 10, covering ? 801 : 799));
        EXPECT_EQ(choice(plan_cloud(look, false), "initial cloud"),
                  covering ? "the model's" : "stereo");
        EXPECT_EQ(choice(plan_cloud(look, true), "initial cloud"), "given");
        TrainOptions options;
        options.iterations = 15000;
        const auto plan = plan_training(look, options, 15000);
        EXPECT_EQ(choice(plan, "densify"), covering ? "off" : "on");
        EXPECT_EQ(choice(plan, "iterations"), covering ? "5000" : "15000");
        EXPECT_EQ(choice(plan, "multi-view"), covering ? "on" : "no such decision");
    }
}

TEST(Plan, TheScheduleFitsTheIterationsThatAreAskedFor) {
    TrainOptions options;
    options.iterations = 300, options.loss.tv_normal.start = 3000;
    const auto plan = plan_training(look_of(patch_scene(3, 10, 1)), options, 15000, 300);
    EXPECT_EQ(choice(plan, "iterations"), "300");
    for (const Decision& decision : plan)
        if (decision.name == "iterations") {
            const std::pair<std::string, std::string> start{"loss.tv_normal.start", "60"};
            EXPECT_NE(std::find(decision.settings.begin(), decision.settings.end(), start),
                      decision.settings.end());
        }
}

TEST(Plan, MultiViewByNeighbours) {
    // The limit is 30 degrees between optical axes.
    for (const double step_deg : {29.0, 31.0}) {
        const auto plan =
            plan_training(look_of(patch_scene(3, step_deg, 1600)), TrainOptions{}, 15000);
        EXPECT_EQ(choice(plan, "multi-view"), step_deg < 30 ? "on" : "off");
    }
}

TEST(Plan, ExposureByTheBrightnessOfSharedPoints) {
    for (const int grey : {114, 116}) {  // of 100; the threshold is 15 %
        Scene scene = patch_scene(4, 10, 1600);
        std::fill(scene.train[0].photo.pixels.begin(), scene.train[0].photo.pixels.end(),
                  static_cast<std::uint8_t>(grey));
        const SceneLook look = look_of(scene);
        EXPECT_NEAR(look.exposure_drift, grey / 100. - 1, 1e-9);
        EXPECT_EQ(choice(plan_training(look, TrainOptions{}, 15000), "exposure"),
                  grey < 115 ? "off" : "fitted");
    }
}

TEST(Schedule, FitsInProportion) {
    TrainOptions o;
    o.iterations = 15000, o.densify.until = 15000, o.loss.normal.start = 7001;
    fit_schedule(o, 5000);
    EXPECT_EQ(o.iterations, 5000);
    EXPECT_EQ(o.densify.until, 5000);
    EXPECT_EQ(o.loss.normal.start, 2334);
    EXPECT_EQ(o.densify.every, 33);
    EXPECT_EQ(o.loss.tv_normal.start, 1) << "the start stays the start";
    EXPECT_EQ(o.tv.vote_every, TvOptions{}.vote_every) << "votes follow the splats";
    // From 1,000 on another time half as long: what is done stays, the rest halves.
    fit_schedule(o, 3000, 1000);
    EXPECT_EQ(o.iterations, 3000);
    EXPECT_EQ(o.loss.normal.start, 1667);
    EXPECT_EQ(o.densify.from, 167) << "before 1,000";
}

TEST(Schedule, NamesEveryOptionThatCountsIterations) {
    TrainOptions o;
    OptionTable table;
    table.add("", o);
    // Votes follow the splats; samples are counted per iteration.
    std::set<std::string> named{"tv.vote_every", "tv.refresh_every", "loss.multi_view.samples"};
    visit_schedule(o, [&](const std::string& key, int, Counts) { named.insert(key); });
    for (const Option& option : table.options())
        if (option.kind == Option::Kind::integer &&
            option.help.find("iteration") != option.help.npos) {
            EXPECT_TRUE(named.contains(option.key)) << option.key << ": " << option.help;
        }
    for (const std::string& key : named) EXPECT_NO_THROW(table.option(key)) << key;
}

TEST(Schedule, NeverStaysNever) {
    TrainOptions o;
    o.densify.opacity_reset_every = 1000000000;
    fit_schedule(o, 10);
    EXPECT_EQ(o.densify.opacity_reset_every, 1000000000);
    EXPECT_GE(o.densify.every, 1);
    fit_schedule(o, 1000000000);
    EXPECT_EQ(o.iterations, kNever) << "no overflow";
}

/// Iterations and seconds that a training takes whose iterations cost `cost(share done)` seconds,
/// with a tenth of a second to get under way again after every look.
template <class Cost>
std::pair<int, double> run_within(double seconds, const Cost& cost) {
    TrainOptions o;
    o.iterations = 10000;
    TimeBudget budget(seconds, o);
    double now = 0;
    int done = 0;
    while (done < o.iterations) {
        if (budget.due(done, now)) budget.fit(done, now, o), now += 0.1;
        ++done;
        now += cost(static_cast<double>(done) / o.iterations);
    }
    return {done, now};
}

TEST(TimeBudgetTest, EndsOnTime) {
    // Three times as slow at its end: the last look, at 88 %, leaves an error of that part only.
    const auto [slower, slower_s] = run_within(30, [](double p) { return 0.01 * (1 + 2 * p); });
    EXPECT_NEAR(slower_s, 30, 1.5);
    EXPECT_LT(slower, 3000);
    const auto [steady, steady_s] = run_within(30, [](double) { return 0.01; });
    EXPECT_NEAR(steady_s, 30, 0.15) << "what the last look costs is not foreseen";
    EXPECT_NEAR(steady, 2950, 20);
}

TEST(TimeBudgetTest, AShortOneIsKeptToo) {
    const auto [done, seconds] = run_within(1.5, [](double) { return 0.004; });
    EXPECT_NEAR(seconds, 1.5, 0.2) << "two tenths: of the last look, and of the one before it";
}

TEST(TimeBudgetTest, IsALimitAndNoGoal) {
    const auto [done, seconds] = run_within(1000, [](double) { return 0.001; });
    EXPECT_EQ(done, 10000);
    EXPECT_NEAR(seconds, 10, 1e-6);
}

TEST(WhatIsOff, IsNeitherRunNorAllocated) {
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
    const char* const parts[] = {"voting", "neighbour", "tv_normal", "multi_view_ncc", "normal"};
    TrainOptions bare = o;
    bare.tv.enabled = bare.densify.enabled = bare.loss.photometric.exposure = false;
    bare.loss.tv_normal.weight = bare.loss.tv_position.weight = bare.loss.normal.weight = 0;
    bare.loss.multi_view_geometry.weight = bare.loss.multi_view_ncc.weight = 0;
    // First, as peaks are those of the program so far.
    const auto [off, state_off, peak_off] = train_now(bare);
    for (const char* name : parts) EXPECT_FALSE(has(off, name)) << name;
    EXPECT_EQ(bytes(state_off, "tv.tensors"), 0u);
    EXPECT_EQ(bytes(state_off, "densify.statistics"), 0u);

    const auto [on, state_on, peak_on] = train_now(o);
    for (const char* name : parts) EXPECT_TRUE(has(on, name)) << name;
    EXPECT_GT(bytes(state_on, "tv.tensors"), 0u);
    EXPECT_GT(bytes(state_on, "densify.statistics"), 0u);
    EXPECT_GT(peak_on, 2 * peak_off) << "lists, votes and a second render";
}

}  // namespace
}  // namespace tvsgs
