// Time estimates of a training before and while it runs.
#include <gtest/gtest.h>

#include <thread>

#include "pipeline/run/progress.h"
#include "plan/time.h"

namespace tvsgs {
namespace {

TEST(TrainingPhases, AreThoseThatTakeLonger) {
    TrainOptions options;
    options.iterations = 1000;
    options.tv.enabled = false;
    LossOptions::terms(options.loss, [](auto, auto, auto& term, auto) { term.weight = 0; });
    options.loss.photometric.weight = 1, options.loss.photometric.exposure_start = 500;
    EXPECT_TRUE(phases_of(options).empty());
    options.loss.normal = {0.1f, 700};
    options.loss.distortion = {0, 300};     // off
    options.loss.tv_normal = {0.1f, 1001};  // not within the training
    options.loss.flatten = {1, 1};          // from the start
    options.tv.enabled = true, options.tv.start = 200;
    EXPECT_EQ(phases_of(options), (std::vector<int>{200, 700}));
}

TEST(TrainingProgress, ClocksStandStillWhilePaused) {
    TrainProgress progress(TrainOptions{}, 100);
    EXPECT_GE(progress.seconds(), 100) << "of a run that goes on";
    progress.pause();
    const double at = progress.seconds();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    EXPECT_EQ(progress.seconds(), at);
    progress.resume();
    EXPECT_GE(progress.seconds(), at);
    EXPECT_LT(progress.seconds(), at + 100);
}

TEST(TimePlans, SayWhatTheyRestOn) {
    TimePlan plan{7, 15, 37, 37, 0.01, 1000, false};
    EXPECT_EQ(
        plan.text(),
        "about 7 s to 15 s for 1,000 iterations; 37 took 10 ms each just now, in all phases of "
        "the schedule");
    plan.steps = 9, plan.high = 1800, plan.grows = true;
    EXPECT_EQ(plan.text(),
              "about 7 s to 30 min for 1,000 iterations; 9 took 10 ms each just now, before later "
              "phases, which may be slower; longer as splats are added");
}

}  // namespace
}  // namespace tvsgs
