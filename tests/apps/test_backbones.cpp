// The choice of a rasteriser by configurations and by files of splats, and combinations that are
// refused.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <regex>
#include <string>

#include "support/command.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

class Backbones : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_backbones_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        ASSERT_EQ(run_tool(folder_, "synth", "--out scene --views 6 --width 48 --height 36").code,
                  0);
        for (const char* config : {"2dgs_sparse", "3dgs"}) {
            const Result run = train(config, config);
            ASSERT_EQ(run.code, 0) << run;
        }
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static Result train(const std::string& config,
                        const std::string& out,
                        const std::string& more = "") {
        return run_tool(
            folder_, "train",
            "--scene scene --config " TVSGS_SOURCE_DIR "/configs/" + config +
                ".json --set init.min_points=0 --iterations 30 --eval --checkpoint-every 20 "
                "--device cpu --quiet --out " +
                out + " " + more);
    }
    static std::string splats(const std::string& run) {
        return contents(folder_ / run / "point_cloud/iteration_30/point_cloud.ply");
    }
    static Result mesh(const std::string& run, const std::string& more = "") {
        return run_tool(folder_, "extract-mesh",
                        "--model " + run +
                            " --device cpu --quiet --no-preview --mesh-resolution 64 "
                            "--out mesh.ply " +
                            more);
    }
    static void expect_refused(const Result& r, int code, const std::string& why) {
        EXPECT_EQ(r.code, code) << r;
        EXPECT_TRUE(r.says(why)) << "'" << why << "' is not in: " << r;
    }

    static inline fs::path folder_;
};

TEST_F(Backbones, FilesOfDiscsHaveTwoScalesUnlessThreeAreAskedFor) {
    EXPECT_EQ(splats("2dgs_sparse").find("scale_2"), std::string::npos);
    EXPECT_NE(splats("3dgs").find("scale_2"), std::string::npos);
    const Result three = train("2dgs_sparse", "three", "--set output.ply_scales=three");
    ASSERT_EQ(three.code, 0) << three;
    EXPECT_NE(splats("three").find("scale_2"), std::string::npos);
    for (const char* run : {"2dgs_sparse", "three"}) {
        const Result r = run_tool(folder_, "eval", std::string("nvs --device cpu --model ") + run);
        EXPECT_EQ(r.code, 0) << r;
        const Result m = mesh(run, "--alpha-min 0");
        EXPECT_EQ(m.code, 0) << m;
    }
}

TEST_F(Backbones, SplatsOfAnotherKindAreRefused) {
    expect_refused(mesh("2dgs_sparse", "--set backbone=ewa --set render.depth=auto"), 3,
                   "E_PLY_SCALES: 2dgs_sparse/point_cloud/iteration_30/point_cloud.ply: discs");
    expect_refused(mesh("3dgs", "--set backbone=surfel"), 3,
                   "ellipsoids (splats with three scales)");
    const Result r = train("2dgs_sparse", "2dgs_sparse",
                           "--resume --iterations 60 --set backbone=ewa --set "
                           "render.depth=auto --set loss.distortion.weight=0");
    expect_refused(r, 2, "splats of backbone 'surfel', but the configuration has 'ewa'");
}

TEST_F(Backbones, ASplatFileChoosesItsRasteriser) {
    const std::string file = "/point_cloud/iteration_30/point_cloud.ply",
                      discs = "2dgs_sparse" + file, ellipsoids = "3dgs" + file;
    for (const std::string& splats : {discs, ellipsoids}) {
        const Result m = mesh(splats, "--scene scene --alpha-min 0");
        EXPECT_EQ(m.code, 0) << m;
    }
    const std::string both = "discs (splats with two scales), but backbone 'rade' draws ellipsoids";
    expect_refused(mesh(discs, "--scene scene --set backbone=rade"), 3, both);
    expect_refused(mesh(ellipsoids, "--scene scene --set backbone=surfel"), 3,
                   "ellipsoids (splats with three scales), but backbone 'surfel' draws discs");
    const std::string to_spz = " discs.spz --scene scene --device cpu --quiet";
    EXPECT_EQ(run_tool(folder_, "export", discs + to_spz).code, 0);
    expect_refused(run_tool(folder_, "export", discs + to_spz + " --set backbone=rade"), 3, both);

    const std::string beside =
        "--scene scene --iterations 2 --set init.min_points=0 --device cpu "
        "--quiet --set init.fixed_splats=" +
        discs + " --out beside ";
    expect_refused(run_tool(folder_, "train", beside + "--set backbone=rade"), 3, both);
    const Result r = run_tool(folder_, "train", beside);
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_NE(contents(folder_ / "beside/config.json").find("\"backbone\": \"surfel\""),
              std::string::npos);
}

TEST_F(Backbones, TermsThatARasteriserDoesNotServeAreRefused) {
    expect_refused(train("3dgs", "refused", "--set loss.distortion.weight=1"), 2,
                   "backbone 'ewa' does not make the maps it compares (distortion)");
    expect_refused(train("2dgs_sparse", "refused", "--set loss.flatten.weight=1"), 2,
                   "the splats of backbone 'surfel' are flat");
    EXPECT_FALSE(fs::exists(folder_ / "refused"));
}

TEST_F(Backbones, ThePlanLeavesOutWhatFlatSplatsDoNotNeed) {
    for (const auto& [backbone, why] : {std::pair{"surfel", "the splats are flat"},
                                        {"rade", "the rasteriser fades thin splats"}}) {
        const Result plan =
            run_tool(folder_, "train",
                     std::string("--scene scene --device cpu --plan --set backbone=") + backbone);
        ASSERT_EQ(plan.code, 0) << plan;
        EXPECT_TRUE(
            std::regex_search(plan.out, std::regex(std::string("flatten loss +off +") + why)))
            << plan.out;
    }
}

}  // namespace
}  // namespace tvsgs
