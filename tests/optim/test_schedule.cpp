// Schedules: shortened, stretched, and fitted to a time budget.
#include <gtest/gtest.h>

#include <set>
#include <utility>

#include "io/config/config.h"
#include "optim/loop/schedule.h"

namespace tvsgs {
namespace {

TEST(Schedule, FitsInProportion) {
    TrainOptions o;
    o.iterations = 15000, o.densify.until = 15000, o.loss.normal.start = 7001;
    fit_schedule(o, 5000);
    EXPECT_EQ(o.iterations, 5000);
    EXPECT_EQ(o.densify.until, 4000) << "what grows last has time to settle";
    EXPECT_EQ(o.loss.normal.start, 2334);
    EXPECT_EQ(o.densify.every, 100) << "growth keeps its distances";
    EXPECT_EQ(o.densify.opacity_reset_every, 1000);
    EXPECT_EQ(o.densify.trim_every, 500);
    EXPECT_EQ(o.loss.tv_normal.start, 1) << "the start stays the start";
    EXPECT_EQ(o.tv.vote_every, TvOptions{}.vote_every) << "votes follow the splats";
    // From iteration 1,000, which is now 900, the rest is stretched by half.
    const TrainOptions original = o;
    fit_schedule(original, 1000, o, 900, 2900);
    EXPECT_EQ(o.iterations, 2900);
    EXPECT_EQ(o.loss.normal.start, 1567);
    EXPECT_EQ(o.densify.from, 167) << "is past";
    EXPECT_EQ(o.loss.tv_normal.start, 1);
    // Longer: terms that start at once still do.
    fit_schedule(o, 29000);
    EXPECT_EQ(o.loss.tv_normal.start, 1);
}

TEST(Schedule, WhatIsHardlyShorterSettlesHardlyLonger) {
    for (const auto& [iterations, until] :
         {std::pair(15000, 15000), {14999, 14998}, {14500, 14000}, {14000, 13000}, {9000, 8000}}) {
        TrainOptions o;
        o.iterations = o.densify.until = 15000;
        fit_schedule(o, iterations);
        EXPECT_EQ(o.densify.until, until);
    }
}

TEST(Schedule, GrowthIsLeftOutWhereThereIsNoTimeForIt) {
    for (const int iterations : {1, 50, 491, 1000}) {
        TrainOptions o;
        o.iterations = 15000;
        fit_schedule(o, iterations);
        EXPECT_LE(o.densify.until, o.densify.from) << iterations;
        EXPECT_EQ(o.densify.until, 0) << "no reset and no trim either, at " << iterations;
    }
    // A configured schedule with shorter intervals keeps them.
    TrainOptions close;
    close.iterations = 4000, close.densify.every = 10, close.densify.opacity_reset_every = 300;
    close.densify.until = 2000;
    fit_schedule(close, 3000);
    EXPECT_EQ(close.densify.every, 10);
    EXPECT_EQ(close.densify.opacity_reset_every, 300);
    EXPECT_EQ(close.densify.until, 1500);
    // Squeezed during the run: the end is near, so growth stops.
    TrainOptions original, squeezed;
    original.iterations = squeezed.iterations = 15000;
    fit_schedule(original, 6000, squeezed, 6000, 6800);
    EXPECT_LE(squeezed.densify.until, 5800);
}

TEST(Schedule, NamesEveryOptionThatCountsIterations) {
    TrainOptions o;
    OptionTable table;
    table.add("", o);
    // Votes and targets follow the splats; samples are per iteration.
    std::set<std::string> named{"tv.vote_every", "tv.refresh_every", "loss.multi_view.samples",
                                "loss.anchored_depth.refresh_every"};
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
    EXPECT_EQ(o.iterations, 1000000000);
    EXPECT_EQ(o.loss.normal.start, kNever) << "no overflow";
}

/// Iterations and seconds of a training whose iterations cost `cost(share done)` seconds, plus a
/// tenth of a second after every fit.
template <class Cost>
std::pair<int, double> run_within(double seconds, const Cost& cost, int iterations = 10000) {
    TrainOptions o;
    o.iterations = iterations;
    TimeBudget budget(seconds, o, 0);
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
    // Three times as slow at its end: after the last fit at 88 % only an error of the rest remains.
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

TEST(TimeBudgetTest, SlowIterationsAreSeenAtOnce) {
    // One iteration takes an eighth of the budget; most of the rest goes to the fits.
    const auto [done, seconds] = run_within(2, [](double) { return 0.25; });
    EXPECT_LE(seconds, 2.5);
    EXPECT_GE(done, 5);
}

TEST(TimeBudgetTest, ASlowStartIsNotTheSpeedOfTheRest) {
    bool first = true;
    const auto [done, seconds] =
        run_within(3, [&](double) { return std::exchange(first, false) ? 0.5 : 0.005; });
    EXPECT_NEAR(seconds, 3, 0.4) << "what the last looks cost is not foreseen";
    EXPECT_GT(done, 200);
}

TEST(TimeBudgetTest, IsALimitAndNoGoal) {
    bool first = true;
    const auto [all, all_s] = run_within(
        20, [&](double) { return std::exchange(first, false) ? 1.2 : 0.05; }, 100);
    EXPECT_EQ(all, 100) << "what the slow first one took from the rest is given back";
    EXPECT_LT(all_s, 8);
    const auto [done, seconds] = run_within(1000, [](double) { return 0.001; });
    EXPECT_EQ(done, 10000);
    EXPECT_NEAR(seconds, 10, 1e-6);
}

}  // namespace
}  // namespace tvsgs
