// However a command ends, and wherever it writes: existing files of the user stay unchanged, and
// the next command accepts the results of a successful one.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <vector>

#include "support/command.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

using Tree = std::map<std::string, std::string>;

/// Every file below `folder`, with its contents.
Tree tree_of(const fs::path& folder) {
    Tree files;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
        if (entry.is_regular_file()) files[entry.path().string()] = contents(entry.path());
    return files;
}

/// The files of `mine` that are missing or changed; ignores new files.
std::vector<std::string> harmed(const Tree& mine) {
    std::vector<std::string> names;
    for (const auto& [name, text] : mine)
        if (!fs::is_regular_file(name) || contents(name) != text) names.push_back(name);
    return names;
}

class UserFiles : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_user_files_" + std::to_string(getpid()));
        fs::remove_all(folder_);
        fs::create_directories(folder_);
        ASSERT_EQ(
            call("synth", "--out scene --views 8 --width 64 --height 48 --arc 50 --quiet").code, 0);
        ASSERT_EQ(train("--scene scene --out run").code, 0);
        // What make_home() copies: files of the truth by name, without their megabytes.
        fs::copy(folder_ / "scene", folder_ / "small", fs::copy_options::recursive);
        fs::remove(folder_ / "small/.tvsgs-files");
        for (const auto& entry : fs::directory_iterator(folder_ / "small/gt"))
            write(fs::relative(entry.path(), folder_));
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static Result call(const std::string& tool, const std::string& arguments) {
        return run_tool(folder_, tool, arguments, 1);
    }
    static Result train(const std::string& arguments) { return call("train", kTrain + arguments); }

    /// A scene and forty other files of the user, with names that commands use.
    static Tree make_home() {
        fs::remove_all(folder_ / "home");
        fs::create_directories(folder_ / "home");
        fs::copy(folder_ / "small", folder_ / "home/scene", fs::copy_options::recursive);
        for (const char* name : {"notes.txt",
                                 "thesis.md",
                                 "mine.ply",
                                 "mine.png",
                                 "fresh.png",
                                 "cloud.ply",
                                 "scores.json",
                                 "table.csv",
                                 "plot.svg",
                                 "maps/priors.json",
                                 "maps/depth/0000.npy",
                                 "maps/normal/0000.npy",
                                 "maps/README",
                                 "project/config.json",
                                 "project/report.html",
                                 "project/cameras.json",
                                 "project/log.jsonl",
                                 "project/test/0000.png",
                                 "project/mesh/mesh.ply",
                                 "project/images/0000.png",
                                 "project/sparse/0/cameras.txt",
                                 "photos/0000.png",
                                 "photos/0001.jpg",
                                 "splats/point_cloud.ply",
                                 "splats/mesh.ply",
                                 "splats/mesh.png",
                                 "config.json",
                                 "log.jsonl",
                                 "report.html",
                                 "README.md"})
            write(fs::path("home") / name);
        Tree mine = tree_of(folder_ / "home");
        // A run that contains files of the user.
        fs::copy(folder_ / "run", folder_ / "home/run", fs::copy_options::recursive);
        for (const char* name :
             {"mesh/edited.blend", "mesh/mesh.png", "test/mine.txt", "per_view.json", "paper.tex",
              "checkpoints/keep.ckpt", "point_cloud/mine.ply", "eval/mine.json",
              "point_cloud/iteration_8/edited.ply", "point_cloud/iteration_99/notes.txt"}) {
            const std::string path = write(fs::path("home/run") / name);
            mine[path] = contents(path);
        }
        return mine;
    }
    static std::string write(const fs::path& path) {
        fs::create_directories((folder_ / path).parent_path());
        std::ofstream(folder_ / path, std::ios::binary) << "hours of work: " << path;
        return (folder_ / path).string();
    }

    static inline fs::path folder_;
    static inline const std::string kTrain = "--device cpu --iterations 8 --set tv.k=20 --quiet ";
};

TEST_F(UserFiles, TheComparisonSeesWhatIsHarmed) {
    const Tree mine = make_home();
    EXPECT_GT(mine.size(), 40u + 8u);
    EXPECT_TRUE(harmed(mine).empty());
    write("home/new.txt");
    EXPECT_TRUE(harmed(mine).empty());
    fs::remove(folder_ / "home/run/test/mine.txt");
    std::ofstream(folder_ / "home/notes.txt", std::ios::app) << ".";
    fs::rename(folder_ / "home/scene/images/0000.png", folder_ / "home/scene/images/moved.png");
    EXPECT_EQ(harmed(mine).size(), 3u);
}

TEST_F(UserFiles, NoCommandHarmsThem) {
    std::vector<std::string> commands;
    for (const char* out : {"home", "home/run", "home/project", "home/scene", "home/scene/images",
                            "home/maps", "home/photos", "home/new"})
        for (const char* more : {"", " --overwrite", " --resume", " --iterations 9 --resume"})
            commands.push_back("train " + kTrain + "--scene home/scene --out " + out + more);
    for (const char* out : {"home/scene", "home/run", "home/project", "home/photos", "home"})
        for (const char* more : {"", " --overwrite"})
            commands.push_back(std::string("synth --views 4 --shape torus --quiet --out ") + out +
                               more);
    for (const char* out :
         {"--out home/cloud.ply", "--out home/scene/images/0000.png", "--maps home/maps",
          "--maps home/scene", "--maps home/scene/images", "--out home/new.ply --maps home/run"})
        commands.push_back(
            std::string(
                "init --device cpu --quiet --scene home/scene --num-views 3 --max-points 99 ") +
            out);
    for (const char* out :
         {"", "--out home/mine.ply", "--out home/fresh.ply", "--out home/scene/images/0000.png",
          "--out home/scene/images/0000.ply", "--out home/run/mesh/edited.blend",
          "--out home/run/point_cloud/mine.ply", "--out home/project/mesh/mesh.ply"})
        commands.push_back(
            std::string(
                "extract-mesh --device cpu --quiet --mesh-resolution 24 --model home/run ") +
            out);
    for (const char* out : {"scores.json", "scene/images/0001.png", "run/eval/mine.json"})
        commands.push_back(std::string("eval geometry --quiet --point-samples 2000 --pred "
                                       "scene/gt/points.ply --gt scene/gt/mesh.ply "
                                       "--out home/") +
                           out);
    for (const char* more :
         {"eval nvs --device cpu --model home/run", "eval report --model home/run",
          "eval run --device cpu --model home/run",
          "eval table --runs home/run --out home/table.md",
          "eval table --runs home/run --out home/thesis.md",
          "bench vote --device cpu --synthetic 300 --out home/scores.json"})
        commands.push_back(more);

    // Normal end, interrupted, and on a disk where a file gets at most 4 KiB.
    const std::vector<std::string> ends = {"", "timeout -s INT 0.1 ", "ulimit -f 8; "};
    Tree mine = make_home();
    for (const std::string& command : commands)
        for (const std::string& end : ends) {
            const Result r =
                run_script(folder_, "OMP_NUM_THREADS=1; export OMP_NUM_THREADS; " + end +
                                        TVSGS_BIN_DIR "/tvsgs-" + command + " >out.txt 2>err.txt");
            for (const std::string& name : harmed(mine))
                ADD_FAILURE() << end << "tvsgs-" << command << " harmed " << name << "\n" << r;
            EXPECT_NE(r.code, 1) << command << ": " << r;
            if (!end.empty() || r.code == 0 || HasFailure()) mine = make_home();
        }
}

TEST_F(UserFiles, WhatACommandLeavesTheNextOneTakes) {
    const auto takes = [&](const std::string& tool, const std::string& arguments) {
        const Result r = call(tool, arguments);
        EXPECT_EQ(r.code, 0) << tool << " " << arguments << ": " << r;
    };
    const std::string mesh = "--device cpu --quiet --mesh-resolution 48 ";
    takes("init", "--device cpu --quiet --scene scene --out cloud.ply --maps maps");
    takes("init", "--device cpu --quiet --scene scene --out cloud.ply --maps maps");
    for (const std::string& way :
         {std::string("--scene scene --init-ply cloud.ply --eval"),
          std::string("--scene scene --eval --config " TVSGS_SOURCE_DIR "/configs/3dgs.json")}) {
        fs::remove_all(folder_ / "next");
        takes("train", kTrain + way + " --out next");
        takes("train", kTrain + "--resume next --iterations 12");
        takes("extract-mesh", mesh + "--model next");
        takes("extract-mesh", mesh + "--model next --out next.ply");
        takes("extract-mesh", mesh + "--model next --out next.ply");  // may replace its own file
        takes("eval",
              "geometry --quiet --point-samples 2000 --pred next.ply --gt scene/gt/mesh.ply --out "
              "next.json");
        takes(
            "eval",
            "geometry --quiet --point-samples 2000 --pred "
            "next/point_cloud/iteration_12/point_cloud.ply --gt scene/gt/mesh.ply --out next.json");
        takes("eval", "nvs --device cpu --model next");
        takes("eval", "run --device cpu --model next");
        takes("eval", "table --runs next --out next.md");
        takes("eval", "table --runs next --out next.md");
    }
}

}  // namespace
}  // namespace tvsgs
