// tvsgs-bench stages with few splats: every case, and its report.
#include "apps/test_bench.h"

namespace tvsgs {
namespace {

using nlohmann::json;

TEST_F(Bench, TimesTheStagesOfEveryView) {
    for (const std::string& device : devices()) {
        SCOPED_TRACE(device);
        const Result r =
            bench("stages --scale 0.002 --repetitions 2 --warm-up 1 --device " + device);
        ASSERT_EQ(r.code, 0) << r.err;
        ASSERT_EQ(r.lines.size(), 10u);
        std::vector<std::string> names;
        for (const json& line : r.lines) {
            const std::string name = line.at("case");
            names.push_back(name);
            const json& counters = line.at("counters");
            const int splats = counters.at("splats"), visible = counters.at("visible"),
                      fragments = counters.at("fragments");
            EXPECT_EQ(line.at("stages").size(), 10u) << line.at("stages").dump();
            for (const json& stage : line.at("stages")) {
                EXPECT_EQ(stage.at("repetitions"), 2);
                EXPECT_GT(stage.at("median_ms").get<double>(), 0);
                EXPECT_FALSE(stage.contains("floor_ms")) << "floors are for full size";
            }
            const std::int64_t tests = counters.at("warp_tests"), hits = counters.at("warp_hits"),
                               draws = counters.at("warp_draws"), sums = counters.at("warp_sums");
            EXPECT_LE(tests, 4 * std::int64_t{fragments}) << "a tile is four warps";
            EXPECT_LE(hits, tests);
            EXPECT_LE(draws, hits);
            EXPECT_LE(sums, draws);
            const double evaluations = counters.at("evaluations_per_pixel"),
                         contributions = counters.at("contributions_per_pixel");
            EXPECT_LE(contributions, evaluations);
            EXPECT_EQ(contributions > 0, fragments > 0);
            // The intended properties of each view.
            if (name.starts_with("w540")) {
                EXPECT_NEAR(visible, splats / 2, splats / 20);
                EXPECT_NEAR(fragments / double(visible), 3, 1);
            }
            if (name.starts_with("w1200")) {
                EXPECT_NEAR(fragments / double(visible), 5, 1.5);
            }
            if (name == "c256") {
                EXPECT_EQ(visible, splats);
            }
            if (name == "one_tile") {
                EXPECT_EQ(fragments, visible);
            }
            if (name == "huge") {
                EXPECT_EQ(fragments, visible * 3 * 2) << "all tiles of 42 x 24 pixels";
            }
            if (name == "needles") {
                EXPECT_GT(fragments, 3 * visible);
            }
            if (name == "empty") {
                EXPECT_EQ(fragments, 0);
            }
            if (name == "one") {
                EXPECT_EQ(visible, 1);
            }
        }
        EXPECT_EQ(names,
                  (std::vector<std::string>{"w540", "w1200", "w540_morton", "w1200_morton", "c256",
                                            "one_tile", "huge", "needles", "empty", "one"}));
    }
}

TEST_F(Bench, GrowsInSplatsOrPixelsWithAsManyOverEachPixel) {
    const auto run = [&](const std::string& scales) {
        const Result r = bench(
            "stages --case w540 --scale 0.01 --repetitions 1 --warm-up 1 --device cpu " + scales);
        EXPECT_EQ(r.code, 0) << r.err;
        return r.lines.at(0);
    };
    const json base = run(""), splats = run("--splats-scale 4"), pixels = run("--pixels-scale 4");
    EXPECT_EQ(splats.at("counters").at("splats"), 60000);
    EXPECT_EQ(splats.at("width"), base.at("width"));
    EXPECT_EQ(pixels.at("counters").at("splats"), 15000);
    EXPECT_EQ(pixels.at("width"), 192);
    for (const json& line : {splats, pixels})
        EXPECT_NEAR(line.at("counters").at("contributions_per_pixel").get<double>() /
                        base.at("counters").at("contributions_per_pixel").get<double>(),
                    1, 0.3)
            << "the low-pass filter makes small splats larger";
}

TEST_F(Bench, RefusesWhatItCannotTime) {
    EXPECT_EQ(bench("stages --case nothing").code, 2);
    EXPECT_EQ(bench("").code, 2);
}

const std::string kDense = " --config " TVSGS_SOURCE_DIR "/configs/pgsr_dense.json ";

TEST_F(Bench, TimesAnIterationThatComparesViews) {
    for (const std::string& device : devices()) {
        SCOPED_TRACE(device);
        const std::string small =
            "stages --case w540_morton --scale 0.02 --repetitions 3 --warm-up 1 --device " + device;
        const Result r = bench(small + kDense);
        ASSERT_EQ(r.code, 0) << r.err;
        const json& line = r.lines.at(0);
        std::vector<std::string> stages, losses;
        for (const json& stage : line.at("stages")) stages.push_back(stage.at("stage"));
        EXPECT_EQ(stages, (std::vector<std::string>{
                              "all, one wait", "other views, forward", "clear gradients",
                              "compare views", "photometric loss", "flatten loss", "normal loss",
                              "multi_view_geometry loss", "multi_view_ncc loss", "watch losses",
                              "other views, backward", "project backward and Adam", "project",
                              "colours", "tile lists", "blend", "blend backward"}));
        for (const json& loss : line.at("losses")) {
            losses.push_back(loss.at("loss"));
            EXPECT_TRUE(loss.at("value").is_number()) << "not finite: " << loss.dump();
            EXPECT_GT(loss.at("value"), 0) << loss.dump();
        }
        EXPECT_EQ(losses, (std::vector<std::string>{"photometric", "flatten", "normal",
                                                    "multi_view_geometry", "multi_view_ncc"}));
        const int width = line.at("width"), height = line.at("height");
        const json& counters = line.at("counters");
        EXPECT_GT(counters.at("compared_pixels"), 0.6 * width * height) << "the views overlap";
        EXPECT_EQ(line.at("channels"), "color_plane");
        if (device == "cpu") {  // a GPU waits longer than it works here
            EXPECT_LT(line.at("unaccounted_share"), 0.03);
            EXPECT_GT(line.at("unaccounted_share"), -0.03);
        }
        // As many blended splats as without a neighbour, although on a surface.
        const Result plain = bench(small);
        ASSERT_EQ(plain.code, 0) << plain.err;
        const json& others = plain.lines.at(0).at("counters");
        for (const char* key : {"fragments", "evaluations_per_pixel", "contributions_per_pixel"})
            EXPECT_NEAR(counters.at(key).get<double>() / others.at(key).get<double>(), 1, 0.2)
                << key;
    }
}

TEST_F(Bench, TimesTheIterationOfAConfigurationOnly) {
    const Result r = bench(
        "stages --case one --repetitions 1 --warm-up 1 --device cpu --config " TVSGS_SOURCE_DIR
        "/configs/3dgs.json --set lr.scale=0.004");
    ASSERT_EQ(r.code, 0) << r.err;
    EXPECT_EQ(r.lines.at(0).at("losses").size(), 1u);
    EXPECT_EQ(r.lines.at(0).at("channels"), "color");
    for (const std::string& flags :
         {kDense + "--set tv.enabled=true", kDense + "--set iterations=0"})
        EXPECT_EQ(bench("stages --case one --device cpu" + flags).code, 2) << flags;
}

}  // namespace
}  // namespace tvsgs
