// tvsgs-bench stages on few splats: every case, every channel set, and what it reports.
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
                      slots = counters.at("slots");
            EXPECT_EQ(line.at("stages").size(), 9u) << line.at("stages").dump();
            for (const json& stage : line.at("stages")) {
                EXPECT_EQ(stage.at("repetitions"), 2);
                EXPECT_GT(stage.at("median_ms").get<double>(), 0);
                EXPECT_FALSE(stage.contains("floor_ms")) << "floors are for full size";
            }
            // What each view is made to be.
            if (name.starts_with("w540")) {
                EXPECT_NEAR(visible, splats / 2, splats / 20);
                EXPECT_NEAR(slots / double(visible), 3, 1);
            }
            if (name.starts_with("w1200")) {
                EXPECT_NEAR(slots / double(visible), 5, 1.5);
            }
            if (name == "c256") {
                EXPECT_EQ(visible, splats);
            }
            if (name == "one_tile") {
                EXPECT_EQ(slots, visible);
            }
            if (name == "huge") {
                EXPECT_EQ(slots, visible * 3 * 2) << "all tiles of 42 x 24 pixels";
            }
            if (name == "needles") {
                EXPECT_GT(slots, 3 * visible);
            }
            if (name == "empty") {
                EXPECT_EQ(slots, 0);
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

TEST_F(Bench, TimesTheStagesOfPlaneChannels) {
    for (const std::string channels : {"color_plane", "plane"}) {
        const Result r = bench(
            "stages --case one --repetitions 1 --warm-up 1 --device cpu --channels " + channels);
        ASSERT_EQ(r.code, 0) << r.err;
        EXPECT_EQ(r.lines.at(0).at("channels"), channels);
    }
    EXPECT_EQ(bench("stages --case nothing").code, 2);
    EXPECT_EQ(bench("").code, 2);
}

}  // namespace
}  // namespace tvsgs
