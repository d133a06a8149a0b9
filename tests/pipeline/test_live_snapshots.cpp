// Snapshots of a running training in RUN/live/.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include "io/files/json_value.h"
#include "io/files/read_file.h"
#include "io/splats/ply.h"
#include "io/splats/splat_files.h"
#include "pipeline/run/live_snapshots.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

class LiveFolder : public testing::Test {
protected:
    void SetUp() override {
        run_ =
            (fs::path(testing::TempDir()) / ("tvsgs_live_" + std::to_string(::getpid()))).string();
        fs::remove_all(run_);
        fs::create_directories(run_);
    }
    void TearDown() override { fs::remove_all(run_); }

    static void wait_until_due(LiveSnapshots& live) {
        for (int i = 0; i < 500 && !live.due(); ++i) std::this_thread::sleep_for(10ms);
        ASSERT_TRUE(live.due());
    }

    std::string run_;
};

TEST_F(LiveFolder, HoldsTheSplatsAsFilesHaveThemAndGoesInTheEnd) {
    Gaussians<Cpu> splats = test::random_gaussians(300, 7, 0.05, 2),
                   same = test::random_gaussians(300, 7, 0.05, 2);
    for (Gaussians<Cpu>* g : {&splats, &same}) {
        g->filter.resize(300);
        for (std::size_t i = 0; i < 300; ++i) g->filter[i] = 0.02f + 1e-4f * float(i);
    }
    write_splat_ply(run_ + "/same.ply", same);
    const Gaussians<Cpu> expected = read_splat_ply(run_ + "/same.ply");

    LiveSnapshots live(run_, {1e6, -2, 0.5}, 0.05);
    EXPECT_FALSE(live.due()) << "not before its time";
    wait_until_due(live);
    live.write(40, 900, 2.5, std::move(splats));
    EXPECT_FALSE(live.due()) << "has just been";
    wait_until_due(live);
    const JsonValue state = parse_json_value(read_bytes(run_ + "/live/state.json"), "state");
    EXPECT_EQ(state["iteration"].number, 40);
    EXPECT_EQ(state["iterations"].number, 900);
    EXPECT_EQ(state["gaussians"].number, 300);
    EXPECT_EQ(state["origin"].items.at(0).number, 1e6);
    const Gaussians<Cpu> found = read_spz(run_ + "/live/splats.spz", SplatFrame::rdf).splats;
    ASSERT_EQ(found.size(), 300);
    EXPECT_EQ(found.sh_degree, 0);
    for (std::size_t i = 0; i < 300; ++i) {
        for (int k = 0; k < 3; ++k) {
            EXPECT_NEAR(found.means[i][k], expected.means[i][k], 1e-4);
            EXPECT_NEAR(found.log_scales[i][k], expected.log_scales[i][k], 1 / 31.0) << "filtered";
            EXPECT_NEAR(found.sh[i][k], expected.sh[i][k], 0.014);
        }
        const auto opacity = [](float logit) { return 1 / (1 + std::exp(-logit)); };
        EXPECT_NEAR(opacity(found.opacity_logits[i]), opacity(expected.opacity_logits[i]), 0.002);
    }
    live.finish();
    EXPECT_FALSE(fs::exists(run_ + "/live")) << "the results are what counts then";
}

TEST_F(LiveFolder, WhatAKilledTrainingLeftGoes) {
    for (const double every : {0.0, 1000.0}) {
        fs::create_directories(run_ + "/live");
        for (const char* name : {"/live/splats.spz", "/live/state.json"})
            std::ofstream(run_ + name) << "old";
        LiveSnapshots live(run_, {}, every);
        EXPECT_TRUE(fs::is_empty(run_)) << every;
    }
}

TEST_F(LiveFolder, IsNotThereUnlessAskedFor) {
    LiveSnapshots live(run_, {}, 0);
    std::this_thread::sleep_for(20ms);
    EXPECT_FALSE(live.due());
    live.finish();
    EXPECT_TRUE(fs::is_empty(run_));
}

TEST_F(LiveFolder, WhatCannotBeWrittenEndsNothingButTheSnapshots) {
    std::ofstream(run_ + "/live") << "a file in the way";
    LiveSnapshots live(run_, {}, 0.01);
    for (int i = 0; i < 2; ++i) {
        wait_until_due(live);
        live.write(i, 9, 1, test::random_gaussians(5, 1));
    }
    std::this_thread::sleep_for(50ms);
    EXPECT_FALSE(live.due()) << "it has given up";
    live.finish();
    EXPECT_TRUE(fs::is_regular_file(run_ + "/live")) << "and takes nobody's file away";
}

}  // namespace
}  // namespace tvsgs
