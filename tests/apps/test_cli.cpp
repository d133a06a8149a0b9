// The commands as a user runs them: scene, training, mesh and scores; and what they refuse.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>

#include "support/numeric.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

std::string contents(const fs::path& path) {
    std::ifstream in(path, std::ios::binary);
    std::ostringstream out;
    out << in.rdbuf();
    return out.str();
}

struct Result {
    int code;
    std::string out, err;

    bool says(const std::string& text) const { return err.find(text) != std::string::npos; }
};
std::ostream& operator<<(std::ostream& stream, const Result& result) {
    return stream << "exit code " << result.code << ": " << result.err;
}

constexpr int kIterations = 80;

class Cli : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_cli_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        const Result synth = call("synth", "--out scene --views 12 --width 64 --height 48");
        ASSERT_EQ(synth.code, 0) << synth;
        const Result train =
            call("train",
                 "--scene scene --split train_3 --config " TVSGS_SOURCE_DIR
                 "/configs/pgsr_sparse.json --set loss.normal.start=20 --set tv.k=20 --device cpu "
                 "--report-every 20 --progress json --out run --iterations " +
                     std::to_string(kIterations));
        ASSERT_EQ(train.code, 0) << train;
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    /// Runs tvsgs-<tool> in the folder of the test.
    static Result call(const std::string& tool, const std::string& arguments) {
        const std::string line = "cd '" + folder_.string() +
                                 "' && OMP_NUM_THREADS=2 " TVSGS_BIN_DIR "/tvsgs-" + tool + " " +
                                 arguments + " >out.txt 2>err.txt";
        const int status = std::system(line.c_str());
        return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, contents(folder_ / "out.txt"),
                contents(folder_ / "err.txt")};
    }

    /// A copy of the scene that `spoil` has changed.
    static void spoiled_scene(const std::string& name,
                              const std::function<void(const fs::path&)>& spoil) {
        fs::copy(folder_ / "scene", folder_ / name, fs::copy_options::recursive);
        spoil(folder_ / name);
    }

    /// Training must fail with `code`, say `expected` somewhere, and leave no run folder.
    static void expect_refused(const std::string& arguments,
                               int code,
                               const std::string& expected) {
        const Result r = call("train", arguments + " --device cpu --out refused --iterations 1");
        EXPECT_EQ(r.code, code) << arguments << ": " << r;
        EXPECT_TRUE(r.says(expected)) << "'" << expected << "' is not in: " << r;
        EXPECT_FALSE(fs::exists(folder_ / "refused")) << arguments;
        fs::remove_all(folder_ / "refused");
    }

    static std::string splats(const std::string& run) {
        return contents(folder_ / run / "point_cloud" /
                        ("iteration_" + std::to_string(kIterations)) / "point_cloud.ply");
    }

    static inline fs::path folder_;
};

TEST_F(Cli, RunFolderIsComplete) {
    const fs::path run = folder_ / "run";
    const json config = json::parse(contents(run / "config.json"));
    EXPECT_EQ(config.at("iterations"), kIterations);
    EXPECT_EQ(config.at("backbone"), "pgsr");
    EXPECT_EQ(config.at("loss").at("normal").at("start"), 20);
    EXPECT_EQ(config.at("scene").at("split"), "train_3");
    EXPECT_TRUE(config.at("info").contains("version"));

    std::istringstream log(contents(run / "log.jsonl"));
    std::vector<json> lines;
    for (std::string line; std::getline(log, line);) lines.push_back(json::parse(line));
    ASSERT_EQ(lines.size(), 6u) << "iterations 1, 20, 40, 60, 80 and the summary";
    EXPECT_EQ(lines[0].at("iteration"), 1);
    EXPECT_EQ(lines[4].at("iteration"), kIterations);
    EXPECT_EQ(lines[5].at("event"), "done");
    EXPECT_GT(lines[5].at("psnr").get<double>(), 10);

    const json cameras = json::parse(contents(run / "cameras.json"));
    const json scores = json::parse(contents(run / "eval" / "nvs.json"));
    const auto tested = scores.at("views").get<std::size_t>();
    EXPECT_EQ(cameras.size(), 3 + tested);
    EXPECT_EQ(scores.at("per_view").size(), tested);
    std::size_t pictures = 0;
    for (const auto& file : fs::directory_iterator(run / "test"))
        pictures += file.path().extension() == ".png";
    EXPECT_EQ(pictures, 3 * tested) << "render, normals and depth";
    EXPECT_TRUE(splats("run").starts_with("ply\n"));
}

TEST_F(Cli, ItsConfigurationRepeatsTheRun) {
    const Result again = call("train", "--config run/config.json --device cpu --quiet --out again");
    ASSERT_EQ(again.code, 0) << again;
    EXPECT_EQ(again.err, "") << "--quiet";
    ASSERT_GT(splats("run").size(), 10000u);
    EXPECT_TRUE(splats("again") == splats("run"));
}

TEST_F(Cli, MeshAndScores) {
    const Result mesh =
        call("extract-mesh", "-m run --mesh-resolution 48 --clusters 1 --device cpu");
    ASSERT_EQ(mesh.code, 0) << mesh;
    EXPECT_TRUE(fs::exists(folder_ / "run/mesh/mesh.png"));
    const std::string geometry =
        "geometry --pred run/mesh/mesh.ply --gt scene/gt/mesh.ply --samples 5000 --tau 0.05 ";
    const Result eval = call("eval", geometry + "--out geometry.json --require 'chamfer<=1'");
    ASSERT_EQ(eval.code, 0) << eval;
    EXPECT_GT(json::parse(contents(folder_ / "geometry.json")).at("chamfer").get<double>(), 0);
    EXPECT_EQ(call("eval", geometry + "--require 'chamfer<=1e-9'").code, 8);

    fs::remove(folder_ / "run/eval/nvs.json");
    const Result nvs = call("eval", "nvs -m run --device cpu --require 'psnr>=5'");
    ASSERT_EQ(nvs.code, 0) << nvs;
    EXPECT_TRUE(json::parse(contents(folder_ / "run/eval/nvs.json")).contains("ssim"));
    EXPECT_EQ(call("eval", "nvs -m run --device cpu --require 'psnr>=99'").code, 8);
}

TEST_F(Cli, UsageErrorsNameTheNearest) {
    expect_refused("--scene scene --iteratoins 3", 2, "--iterations");
    expect_refused("--scene scene --set loss.flaten.weight=3", 2, "loss.flatten.weight");
    expect_refused("--scene scene --set tv.k=0", 2, "tv.k");
    std::ofstream(folder_ / "bad.json") << R"({"tv": {"vote_evry": 3}})";
    expect_refused("--scene scene --config bad.json", 2, "tv.vote_every");
    expect_refused("--scene scene --set backbone=pgrs", 2, "pgsr");
    expect_refused("", 2, "--scene");
    EXPECT_EQ(call("train", "--help").code, 0);
    EXPECT_EQ(call("train", "--version").code, 0);
    const Result keys = call("train", "--list-keys");
    EXPECT_EQ(keys.code, 0);
    EXPECT_NE(keys.out.find("tv.vote_every"), std::string::npos);
}

TEST_F(Cli, ScenesThatCannotBeRead) {
    expect_refused("--scene nowhere", 3, "nowhere");
    fs::create_directories(folder_ / "empty");
    expect_refused("--scene empty", 3, "empty");
    expect_refused("--scene scene --num-views 1", 3, "");
    expect_refused("--scene scene --split train_99", 3, "train_9");

    spoiled_scene("no_image",
                  [](const fs::path& scene) { fs::remove(scene / "images" / "0003.png"); });
    expect_refused("--scene no_image --split train_all", 3, "0003.png");
    fs::remove_all(folder_ / "no_image" / "images");
    expect_refused("--scene no_image", 3, "images");
    spoiled_scene("no_points", [](const fs::path& scene) {
        std::ofstream(scene / "sparse/0/points3D.txt") << "# none\n";
    });
    expect_refused("--scene no_points", 3, "points");
    spoiled_scene("nan_pose", [](const fs::path& scene) {
        std::string text = contents(scene / "sparse/0/images.txt");
        std::size_t at = text.find("\n1 ") + 1;  // ID QW QX QY QZ TX ...
        for (int field = 0; field < 5; ++field) at = text.find(' ', at) + 1;
        text.replace(at, text.find(' ', at) - at, "nan");
        std::ofstream(scene / "sparse/0/images.txt") << text;
    });
    expect_refused("--scene nan_pose", 3, "images.txt");
    spoiled_scene("cut_short", [](const fs::path& scene) {
        for (const char* name : {"cameras", "images", "points3D"}) {
            std::ofstream file(scene / "sparse/0" / (name + std::string(".bin")), std::ios::binary);
            file.write("\x01\0\0\0\0\0\0\0\x01\0\0", 11);  // one entry, then the end
        }
    });
    expect_refused("--scene cut_short", 3, ".bin");
}

TEST_F(Cli, OutputsThatCannotBeWritten) {
    const std::string before = contents(folder_ / "run/config.json");
    Result r = call("train", "--scene scene --device cpu --iterations 1 --out run");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("--overwrite")) << r;
    EXPECT_EQ(contents(folder_ / "run/config.json"), before);

    std::ofstream(folder_ / "file") << "precious";
    r = call("train", "--scene scene --device cpu --iterations 1 --out file");
    EXPECT_EQ(r.code, 6) << r;
    EXPECT_EQ(contents(folder_ / "file"), "precious");
}

TEST_F(Cli, NoGpu) {
    if (test::no_cuda().empty()) GTEST_SKIP() << "there is a GPU";
    const Result r = call("train", "--scene scene --device cuda --iterations 1 --out refused");
    EXPECT_EQ(r.code, 5) << r;
    EXPECT_FALSE(fs::exists(folder_ / "refused"));
    EXPECT_EQ(call("train", "--scene scene --device tpu --out refused").code, 2);
}

TEST_F(Cli, ReadersOfARunNameWhatIsMissing) {
    EXPECT_EQ(call("extract-mesh", "-m empty_run --device cpu").code, 3);
    EXPECT_EQ(call("eval", "nvs -m empty_run --device cpu").code, 3);
    EXPECT_EQ(call("eval", "geometry --pred nothing.ply --gt scene/gt/mesh.ply").code, 3);
    EXPECT_EQ(call("eval", "").code, 2);
}

// Last in the file: after all of the above.
TEST_F(Cli, NothingHalfWrittenIsLeft) {
    for (const auto& file : fs::recursive_directory_iterator(folder_))
        EXPECT_EQ(file.path().filename().string().find(".tmp"), std::string::npos) << file.path();
}

}  // namespace
}  // namespace tvsgs
