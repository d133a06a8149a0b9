// The mesh against iterations: a training that starts from stereo does not get worse than its
// start.
#include <algorithm>
#include <cmath>
#include <vector>

#include "command_test.h"

namespace tvsgs {
namespace {

// F1 of the mesh, mean over three thresholds. Starts of three seeds differ by .002.
constexpr double kSpread = 0.003;

class ErrorCurve : public CommandTest {
protected:
    static void SetUpTestSuite() {
        CommandTest::SetUpTestSuite();
        const Result synth = call("synth",
                                  "--out arc --views 4 --test-views 0 --arc 75 --points 300 "
                                  "--width 120 --height 90");
        ASSERT_EQ(synth.code, 0) << synth;
    }
    /// F1 of the mesh after iterations 1, 30 and 60. A pixel is 0.034 wide.
    static std::vector<double> curve(const std::string& run, const std::string& flags = "") {
        const Result trained =
            call("train",
                 "--scene arc --device cpu --iterations 60 --eval-every 30 --eval-mesh "
                 "--gt arc/gt/points.ply --tau 0.01,0.02,0.04 "
                 "--set eval.point_samples=20000 --out " +
                     run + " " + flags);
        EXPECT_EQ(trained.code, 0) << trained;
        EXPECT_TRUE(trained.says("start points by stereo")) << trained;
        std::vector<double> f1;
        std::istringstream log(read(run + "/log.jsonl"));
        for (std::string line; std::getline(log, line);) {
            const json entry = json::parse(line);
            if (!entry.contains("mesh")) continue;
            double sum = 0;
            for (const json& t : entry["mesh"]["thresholds"]) sum += t["f1"].get<double>();
            f1.push_back(sum / 3);
        }
        return f1;
    }
    /// The lowest later point of the curve, minus its first.
    static double change(const std::vector<double>& f1) {
        if (f1.size() != 3) return std::nan("");
        return *std::min_element(f1.begin() + 1, f1.end()) - f1.front();
    }
};

TEST_F(ErrorCurve, NeverFallsBelowItsStart) {
    EXPECT_GT(change(curve("plan", "--set lr.supported=1")), -kSpread) << "with a rate set by hand";
    // The gradients and rates of a training that stereo does not support make the mesh worse, if
    // views are not compared.
    EXPECT_LT(change(curve("free",
                           "--set loss.photometric.geometry=1 --set lr.supported=0 "
                           "--set loss.multi_view_ncc.weight=0 "
                           "--set loss.multi_view_geometry.weight=0")),
              -kSpread);
}

}  // namespace
}  // namespace tvsgs
