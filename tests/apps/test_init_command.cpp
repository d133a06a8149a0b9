// tvsgs-init, and tvsgs-train with its own stereo and with given clouds.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "io/files/npz.h"
#include "io/images/image_file.h"
#include "io/splats/ply.h"
#include "support/command.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

class InitCommand : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_init_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        ASSERT_EQ(call("synth", "--out scene --views 12 --width 96 --height 72"), 0) << err();
        ASSERT_EQ(call("init",
                       "--scene scene --split train_3 --device cpu --out cloud.ply --maps priors"),
                  0)
            << err();
        first_run_ = err();
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static int call(const std::string& tool, const std::string& arguments) {
        return run_tool(folder_, tool, arguments).code;
    }
    static std::string err() { return contents(folder_ / "err.txt"); }
    static void expect_refused(const std::string& tool,
                               const std::string& arguments,
                               int code,
                               const std::string& message) {
        EXPECT_EQ(call(tool, arguments), code) << arguments << ": " << err();
        EXPECT_NE(err().find(message), std::string::npos) << "'" << message << "' not in " << err();
    }

    static inline fs::path folder_;
    static inline std::string first_run_;
};

TEST_F(InitCommand, WritesCloudAndMaps) {
    const PointCloud cloud = read_ply((folder_ / "cloud.ply").string()).points;
    EXPECT_GT(cloud.positions.size(), 300u) << first_run_;
    EXPECT_EQ(cloud.normals.size(), cloud.positions.size());
    EXPECT_EQ(cloud.colors.size(), cloud.positions.size());
    EXPECT_NE(contents(folder_ / "cloud.ply").find("property float confidence"), std::string::npos);

    const auto priors = nlohmann::json::parse(contents(folder_ / "priors/priors.json"));
    EXPECT_EQ(priors.at("version"), 1);
    EXPECT_EQ(priors.at("depth").at("quantity"), "depth");
    EXPECT_EQ(priors.at("normal").at("frame"), "camera_opencv");
    int maps = 0;
    for (const auto& file : fs::directory_iterator(folder_ / "priors/depth")) {
        ++maps;
        const std::string name = file.path().filename();
        const NpyArray depth = read_npy(file.path());
        const NpyArray normal = read_npy(folder_ / "priors/normal" / name);
        const NpyArray confidence = read_npy(folder_ / "priors/confidence" / name);
        ASSERT_EQ(depth.shape, (std::vector<std::int64_t>{72, 96}));
        ASSERT_EQ(normal.shape, (std::vector<std::int64_t>{72, 96, 3}));
        ASSERT_EQ(confidence.shape, depth.shape);
        for (std::size_t i = 0; i < depth.numbers.size(); ++i) {
            const double* n = &normal.numbers[3 * i];
            const double length = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
            EXPECT_EQ(depth.numbers[i] > 0, confidence.numbers[i] > 0);
            EXPECT_NEAR(length, depth.numbers[i] > 0 ? 1 : 0, 1e-4);
        }
    }
    EXPECT_EQ(maps, 3);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "priors/pictures"), {}), 6);
}

TEST_F(InitCommand, SameFileAgain) {
    ASSERT_EQ(call("init", "--scene scene --split train_3 --device cpu --out again.ply --quiet"),
              0);
    EXPECT_EQ(contents(folder_ / "again.ply"), contents(folder_ / "cloud.ply"));
    ASSERT_EQ(
        call("init", "--scene scene --split train_3 --device cpu --out few.ply --max-points 100"),
        0);
    EXPECT_LE(read_ply((folder_ / "few.ply").string()).points.positions.size(), 100u);
}

TEST_F(InitCommand, AnotherSeedIsAnotherCloud) {
    ASSERT_EQ(call("init", "--scene scene --split train_3 --device cpu --out seed.ply --seed 3"),
              0);
    EXPECT_NE(contents(folder_ / "seed.ply"), contents(folder_ / "cloud.ply"));
}

TEST_F(InitCommand, WarnsOfVariablesOfOtherCommands) {
    ::setenv("TVSGS_TV__K", "5", 1);
    EXPECT_EQ(call("init", "--list-keys"), 0);
    EXPECT_NE(err().find("TVSGS_TV__K: this command has no key tv.k; ignored"), std::string::npos)
        << err();
    ::unsetenv("TVSGS_TV__K");
}

TEST_F(InitCommand, RefusesWhatCannotWork) {
    expect_refused("init", "--out x.ply", 2, "--scene");
    expect_refused("init", "--scene scene", 2, "nothing to write");
    expect_refused("init", "--scene scene --out scene", 2, "is a folder");
    expect_refused("init", "--scene scene --out x.ply --spilt train_3", 2, "did you mean --split");
    expect_refused("init", "--scene scene --out x.ply --set stereo.min_consistant=2", 2,
                   "min_consistent");
    expect_refused("init", "--scene scene --views 0,1,2 --out x.ply --set stereo.min_consistent=3",
                   2, "with 3 views a depth has only 2 other views");
    expect_refused("init", "--scene scene --out x.ply --device gpu", 2, "expected auto, cpu");
    expect_refused("init", "--scene nowhere --out x.ply", 3, "nowhere");
    expect_refused("init", "--scene scene --views 0 --out x.ply --device cpu", 3,
                   "needs at least 2 views, found 1");
    expect_refused("init", "--scene scene --split train_3 --device cpu --out /proc/no/x.ply", 6,
                   "/proc/no");
    expect_refused("init", "--scene scene --device cpu --out cloud.ply/x.ply", 6,
                   "cloud.ply is not a folder");
    EXPECT_EQ(err().find("photographs, "), std::string::npos) << "before any work: " << err();
    const std::string masked = "--split train_3 --device cpu --use-masks --out x.ply --scene ";
    fs::copy(folder_ / "scene", folder_ / "maskless", fs::copy_options::recursive);
    fs::remove_all(folder_ / "maskless/masks");
    expect_refused("init", masked + "maskless", 3,
                   "E_MASKS: stereo.use_masks is true, but no training view has a mask");
    fs::create_directories(folder_ / "maskless/masks");
    for (const auto& file : fs::directory_iterator(folder_ / "scene/masks"))
        write_png((folder_ / "maskless/masks" / file.path().filename()).string(),
                  ImageU8(96, 72, 1, 0));
    expect_refused("init", masked + "maskless", 3,
                   "is empty (no pixel of 128 or more); write masks as 0 and 255, remove the view, "
                   "or leave out --use-masks");
    expect_refused("init", "--scene scene --out x.ply --no-pictures", 2, "needs --maps DIR");
    expect_refused("init", "--scene scene --out scene/gt/mesh.ply", 2, "choose another");
    EXPECT_FALSE(fs::exists(folder_ / "x.ply"));
}

TEST_F(InitCommand, MapsAreThoseOfTheLastCall) {
    const std::string maps = "--scene scene --device cpu --maps maps ";
    ASSERT_EQ(call("init", maps + "--views 0,1,2"), 0) << err();
    std::ofstream(folder_ / "maps/notes.txt") << "of the user";
    ASSERT_EQ(call("init", maps + "--views 1,2 --no-pictures"), 0) << err();
    std::set<std::string> left;
    for (const auto& file : fs::recursive_directory_iterator(folder_ / "maps"))
        if (file.is_regular_file()) left.insert(file.path().lexically_relative(folder_ / "maps"));
    std::set<std::string> expected{".tvsgs-files", "priors.json", "notes.txt"};
    for (const char* kind : {"depth", "confidence", "normal"})
        for (const char* view : {"/0001.npy", "/0002.npy"})
            expected.insert(std::string(kind) + view);
    EXPECT_EQ(left, expected);
}

TEST_F(InitCommand, TrainingMakesItsOwnCloud) {
    const std::string train =
        "--scene scene --split train_3 --device cpu --iterations 2 --overwrite --out run ";
    ASSERT_EQ(call("train", train + "--set init.min_points=1000000"), 0) << err();
    EXPECT_NE(err().find("Stereo of 3 views"), std::string::npos) << err();
    ASSERT_EQ(call("train", train + "--set init.min_points=0"), 0) << err();
    EXPECT_EQ(err().find("Stereo of 3 views"), std::string::npos) << err();
}

TEST_F(InitCommand, TrainingChecksForeignClouds) {
    const std::string train =
        "--scene scene --split train_3 --device cpu --iterations 2 --overwrite --out run ";
    ASSERT_EQ(call("train", train + "--init-ply cloud.ply --set init.max_points=200"), 0) << err();
    EXPECT_NE(err().find("thinned to"), std::string::npos) << err();
    PointCloud cloud = read_ply((folder_ / "cloud.ply").string()).points;
    for (Vec3f& p : cloud.positions) p = 1000.0f * p;
    write_cloud_ply((folder_ / "far.ply").string(), cloud);
    expect_refused("train", train + "--init-ply far.ply", 3, "in the frame of the scene");
}

}  // namespace
}  // namespace tvsgs
