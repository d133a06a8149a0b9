// tvsgs-bench train on a scene of a few pixels: its times add up.
#include "apps/test_bench.h"

namespace tvsgs {
namespace {

using nlohmann::json;

TEST_F(Bench, TimesRealTraining) {
    const std::string scene = (folder_ / "scene").string();
    ASSERT_EQ(shell(TVSGS_BIN_DIR "/tvsgs-synth --quiet --views 9 --width 64 --height 48 --out '" +
                    scene + "'"),
              0);
    for (const std::string& device : devices()) {
        SCOPED_TRACE(device);
        const Result r = bench("train --scene '" + scene + "' --eval --iterations 60 --device " +
                               device + " --psnr 5,99 --psnr-every 7");
        ASSERT_EQ(r.code, 0) << r.err;
        ASSERT_EQ(r.lines.size(), 1u);
        const json& line = r.lines[0];
        EXPECT_EQ(line.at("iterations"), 60);
        EXPECT_GT(line.at("seconds").get<double>(), 0);
        double stages = 0;
        std::vector<std::string> names;
        for (const json& stage : line.at("stages")) {
            stages += stage.at("seconds").get<double>();
            names.push_back(stage.at("stage"));
        }
        for (const char* name : {"forward", "losses", "backward", "adam"})
            EXPECT_NE(std::find(names.begin(), names.end(), name), names.end()) << name;
        const double all = line.at("profiled_seconds"), share = line.at("unaccounted_share");
        EXPECT_NEAR(all - stages, share * all, 1e-9 + 1e-9 * all);
        // Iterations take a millisecond on a machine with other load; real ones must stay below 3
        // %.
        EXPECT_LT(share, 0.25);
        EXPECT_GE(share, 0);
        // Any render has 5 dB, so the first evaluation reaches it; none has 99.
        EXPECT_EQ(line.at("reached").at(0).at("iteration"), 7);
        EXPECT_LE(line.at("reached").at(0).at("seconds"), line.at("seconds"));
        EXPECT_TRUE(line.at("reached").at(1).at("seconds").is_null());
    }
    EXPECT_EQ(bench("train --scene '" + scene + "' --iterations 2 --device cpu --psnr 20").code, 2)
        << "no test views";
    EXPECT_EQ(bench("train").code, 2) << "no scene";
}

}  // namespace
}  // namespace tvsgs
