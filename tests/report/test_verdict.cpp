// The first lines of the report: overlap of views, and limits of a run.
#include <gtest/gtest.h>

#include "core/error.h"
#include "report/report.h"

namespace tvsgs {
namespace {

TEST(Coverage, OfTwoViewsSideBySide) {
    // A wall at distance 4. Each view is 4 wide there, 2 beside the next: they share half.
    Gaussians<Cpu> wall;
    std::vector<Vec3f> means;
    for (int y = -60; y <= 60; ++y)
        for (int x = -160; x <= 160; ++x)
            means.push_back({0.025f * static_cast<float>(x), 0.025f * static_cast<float>(y), 4});
    const auto fill = [&] {
        resize(wall, static_cast<int>(means.size()), 0);
        for (std::size_t i = 0; i < means.size(); ++i)
            wall.means[i] = means[i], wall.opacity_logits[i] = 3;
    };
    fill();
    std::vector<ViewCamera> cameras(3);
    for (std::size_t i = 0; i < 3; ++i) {
        ViewCamera& c = cameras[i];
        c.name = std::string(1, static_cast<char>('a' + i));
        c.camera = {128, 64, 128, 128, 64, 32, {}};
        c.camera.camera_from_world.t = {i == 0 ? 1.0f : i == 1 ? -1.0f : 5.0f, 0, 0};
    }
    cameras[2].test = true;  // 4 beside the first
    const JsonValue c = coverage_json(wall, cameras);
    EXPECT_NEAR(c["two"].number, 0.5, 0.03) << "a cell";
    ASSERT_EQ(c["views"].items.size(), 2u);
    const JsonValue &a = c["views"].items[0], &b = c["views"].items[1];
    EXPECT_NEAR(a["lone"].number, 0.5, 0.03);
    EXPECT_EQ(a["side"].text, "left");
    EXPECT_EQ(b["side"].text, "right");
    EXPECT_EQ(a["partner"].text, "b");
    EXPECT_NEAR(a["shared"].number, 0.5, 0.03);
    EXPECT_EQ(c["gap"]["a"].text + c["gap"]["b"].text, "ab");
    // In the plane of the centres: 28 degrees in the middle of the shared part, 27 at its ends.
    EXPECT_NEAR(c["gap"]["angle_deg"].number, 27, 1.5);
    ASSERT_EQ(c["test"].items.size(), 1u) << "it shows the wall's left end";
    EXPECT_EQ(c["test"].items[0]["nearest"].text, "a");

    // A board directly in front of b, without gaps: points behind it are not shared.
    for (int y = -100; y <= 100; ++y)
        for (int x = -100; x <= 100; ++x)
            means.push_back(
                {1 + 0.004f * static_cast<float>(x), 0.004f * static_cast<float>(y), 0.5f});
    fill();
    const JsonValue hidden = coverage_json(wall, cameras);
    EXPECT_LT(hidden["gap"]["shared"].number, 0.1);
    EXPECT_GT(hidden["views"].items[1]["lone"].number, 0.8);
    EXPECT_FALSE(coverage_json(wall, {}));
    EXPECT_FALSE(coverage_json(Gaussians<Cpu>{}, cameras));
}

TEST(Verdicts, RestOnWhatWasMeasured) {
    const auto verdict = [](const std::string& json) {
        return verdict_of(parse_json_value(json, "made up"));
    };
    const auto all = [](const std::vector<std::string>& list) {
        std::string text;
        for (const std::string& one : list) text += one + "\n";
        return text;
    };
    const RunVerdict none = verdict("{}");
    EXPECT_TRUE(none.level.empty()) << none.quality;
    EXPECT_NE(none.quality.find("not measured"), std::string::npos);
    EXPECT_TRUE(none.limits.empty()) << all(none.limits);
    EXPECT_TRUE(none.next.empty()) << "nothing is known of the views: " << all(none.next);
    const auto level = [&](double psnr, double f1) {
        return verdict(str("{\"summary\": {\"event\": \"done\", \"psnr\": ", psnr,
                           ", \"centres\": {\"thresholds\": [{\"tau\": 1, \"f1\": ", f1, "}]}}}"))
            .level;
    };
    EXPECT_EQ(level(27, 0.8), "good");
    EXPECT_EQ(level(26.9, 0.8), "fair") << "the worse one counts";
    EXPECT_EQ(level(30, 0.79), "fair");
    EXPECT_EQ(level(19.9, 0.9), "poor");

    const char* const gaps = R"({"summary": {"event": "done", "psnr": 15, "gaussians": 100},
        "memory": {"first_splats": 10, "most_splats": 100},
        "config": {"densify": {"enabled": true}},
        "views": [{"name": "near", "psnr": 20}, {"name": "far", "psnr": 10}],
        "evaluations": [{"psnr": 17, "iteration": 50}],
        "plan": [{"name": "x", "choice": "off", "reason": "1 < 2"},
                 {"name": "new splats", "choice": "none needed", "reason": "thick",
                  "kept": {"densify.enabled": "true by --set"}},
                 {"name": "exposure", "choice": "fitted", "reason": "dark",
                  "kept": {"loss.photometric.exposure": "false by --set"}}],
        "coverage": {"two": 0.6, "gap": {"a": "a", "b": "b", "angle_deg": 45, "shared": 0.5},
            "views": [{"name": "a", "lone": 0.7, "side": "left", "partner": "b", "shared": 0.1},
                      {"name": "b", "lone": 0.1, "side": "", "partner": "a", "shared": 0.5}],
            "test": [{"name": "near", "nearest": "a", "angle_deg": 10},
                     {"name": "far", "nearest": "b", "angle_deg": 80}]}})";
    const RunVerdict found = verdict(gaps);
    const std::string limits = all(found.limits), next = all(found.next);
    for (const char* part :
         {"1 of 2 test views", "reach 10 dB; the nearer ones reach 20 dB", "40 % of the surface",
          ": a.", "up to 45\u00b0 apart, a and b", "Growth stopped at 100",
          "PSNR was 17 dB after 50 iterations and fell to 15 dB"})
        EXPECT_NE(limits.find(part), std::string::npos) << part << " is not in\n" << limits;
    for (const char* part :
         {"From where the test view far stands: PSNR 10 dB", "b, is 80\u00b0 away",
          "Between a and b: 45\u00b0",
          "The part that only a sees, 70 % of its surface, most in its left half"})
        EXPECT_NE(next.find(part), std::string::npos) << part << " is not in\n" << next;
    EXPECT_EQ(found.left_out, "x (1 < 2).") << "growth was asked for";
    EXPECT_EQ(limits.find("exposure"), std::string::npos) << "it was not fitted";
    const RunVerdict object = verdict(
        R"({"summary": {"event": "done", "psnr": 9, "psnr_masked": 25, "gaussians": 99},
            "config": {"densify": {"enabled": false}, "loss": {"photometric": {"masks": "object"}}},
            "memory": {"first_splats": 99, "most_splats": 100},
            "evaluations": [{"psnr": 12, "psnr_masked": 24, "iteration": 50}]})");
    EXPECT_TRUE(object.limits.empty()) << all(object.limits);
    const RunVerdict well = verdict(
        R"({"summary": {"event": "done"}, "coverage": {"two": 0.97, "views": [], "test": [],
            "gap": {"a": "a", "b": "b", "angle_deg": 12, "shared": 0.8}}})");
    EXPECT_TRUE(well.limits.empty()) << all(well.limits);
    const std::string what =
        verdict(R"({"mesh": {"faces": 9, "size": [1, 2.5, 3], "unit": "metres"},
        "pixel": 0.0123, "coverage": {"two": 0.97},
        "placement": {"rmse_m": 0.02, "checkpoint_rmse_m": 0.05}})")
            .what;
    for (const char* part : {"measures 1 x 2.5 x 3 metres", "covers about 0.012 metres", "see 97 %",
                             "fit to 0.02 m; checkpoints, which took no part, to 0.05 m"})
        EXPECT_NE(what.find(part), std::string::npos) << part << " is not in " << what;
    EXPECT_NE(all(well.next).find("No gap was found: 97 %"), std::string::npos) << all(well.next);
}

}  // namespace
}  // namespace tvsgs
