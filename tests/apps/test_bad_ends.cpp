// Failures are reported: files of the user stay, finished work is kept, and an empty result is an
// error.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <vector>

#include "support/command.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

const std::string kTrain = " --device cpu --iterations 20 --set tv.k=20 ";

class BadEnds : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_bad_ends_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        ASSERT_EQ(call("synth", "--out scene --views 8 --width 48 --height 36 --quiet").code, 0);
        ASSERT_EQ(train("run").code, 0);
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static Result call(const std::string& tool, const std::string& arguments) {
        return run_tool(folder_, tool, arguments);
    }
    static Result train(const std::string& out, const std::string& more = "") {
        return call("train", "--scene scene --split train_3 --out " + out + kTrain + more);
    }
    static void write(const fs::path& path, const std::string& text) {
        fs::create_directories((folder_ / path).parent_path());
        std::ofstream(folder_ / path, std::ios::binary) << text;
    }
    /// Every file below `path`, with its contents.
    static std::map<std::string, std::string> tree(const fs::path& path) {
        std::map<std::string, std::string> files;
        for (const auto& entry : fs::recursive_directory_iterator(folder_ / path))
            if (entry.is_regular_file()) files[entry.path().string()] = contents(entry.path());
        return files;
    }

    static inline fs::path folder_;
};

TEST_F(BadEnds, AFolderWithWorkOfOthersIsNoRunFolder) {
    for (const char* file : {"report.html", "cameras.json", "log.jsonl", "test/0000.png",
                             "mesh/edited.blend", "plan.json", "point_cloud/mine.ply"}) {
        fs::remove_all(folder_ / "mine");
        write(fs::path("mine") / file, "hours of work");
        const auto before = tree("mine");
        for (const char* more : {"", "--overwrite", "--resume"}) {
            const Result r = train("mine", more);
            EXPECT_EQ(r.code, 2) << file << " " << more << ": " << r;
            EXPECT_TRUE(r.says("which a run would replace")) << r;
            EXPECT_EQ(tree("mine"), before) << file << " " << more;
        }
    }
    // Names that a run does not use are no obstacle, nor are empty folders.
    fs::remove_all(folder_ / "mine");
    write("mine/notes.txt", "notes");
    fs::create_directories(folder_ / "mine/test");
    EXPECT_EQ(train("mine").code, 0);
    EXPECT_EQ(contents(folder_ / "mine/notes.txt"), "notes");
    const Result root = train("/");
    EXPECT_EQ(root.code, 2);
    EXPECT_TRUE(root.says("root folder")) << root;
}

TEST_F(BadEnds, OverwritingRemovesWhatTheRunWroteAndNothingElse) {
    fs::copy(folder_ / "run", folder_ / "over", fs::copy_options::recursive);
    const fs::path mine[] = {"over/mesh/edited.blend", "over/test/mine.txt", "over/notes.txt",
                             "over/point_cloud/iteration_20/mine.ply", "over/mine.json"};
    for (const fs::path& file : mine) write(file, "hours of work");
    ASSERT_TRUE(fs::exists(folder_ / "over/point_cloud/iteration_20/point_cloud.ply"));
    ASSERT_TRUE(fs::exists(folder_ / "over/checkpoints/iteration_19.ckpt"));
    const Result r = train("over", "--overwrite --iterations 10");
    ASSERT_EQ(r.code, 0) << r;
    for (const fs::path& file : mine) EXPECT_EQ(contents(folder_ / file), "hours of work") << file;
    EXPECT_FALSE(fs::exists(folder_ / "over/point_cloud/iteration_20/point_cloud.ply"));
    EXPECT_FALSE(fs::exists(folder_ / "over/checkpoints/iteration_19.ckpt"));
    EXPECT_TRUE(fs::exists(folder_ / "over/point_cloud/iteration_10/point_cloud.ply"));
    // A name that the run needs and that now belongs to the user.
    write("over/mesh/mesh.png", "mine");
    const Result mesh = call("extract-mesh", "--model over --device cpu --mesh-resolution 48");
    EXPECT_EQ(mesh.code, 0) << mesh;
    EXPECT_TRUE(mesh.says("mesh.png already exists and is not ours: kept")) << mesh;
    EXPECT_EQ(contents(folder_ / "over/mesh/mesh.png"), "mine");
    fs::remove(folder_ / "over/mesh/mesh.glb");
    write("over/mesh/other.ply", "mine");
    EXPECT_EQ(
        call("extract-mesh", "--model over --device cpu --out over/mesh/other.ply --no-preview")
            .code,
        2);
    EXPECT_EQ(contents(folder_ / "over/mesh/other.ply"), "mine");
    // Without its list, a run's files cannot be told from others.
    fs::remove(folder_ / "over/.tvsgs-files");
    const auto before = tree("over");
    EXPECT_EQ(train("over", "--overwrite").code, 2);
    EXPECT_EQ(call("train", "--resume over --iterations 12 --device cpu").code, 2);
    EXPECT_EQ(tree("over"), before);
}

TEST_F(BadEnds, ScenesKeepWhatTheirUsersAdd) {
    const std::string synth =
        "--shape torus --out made --width 32 --height 24 --points 500 --quiet --views ";
    ASSERT_EQ(call("synth", synth + "6").code, 0);
    for (const char* file : {"made/mine.txt", "made/images/holiday.jpg", "made/own/x"})
        write(file, "mine");
    EXPECT_EQ(call("synth", synth + "4").code, 2) << "without --overwrite";
    const Result r = call("synth", synth + "4 --overwrite");
    ASSERT_EQ(r.code, 0) << r;
    for (const char* file : {"made/mine.txt", "made/images/holiday.jpg", "made/own/x"})
        EXPECT_EQ(contents(folder_ / file), "mine") << file;
    EXPECT_TRUE(fs::exists(folder_ / "made/images/0003.png"));
    EXPECT_FALSE(fs::exists(folder_ / "made/images/0004.png"));
    write("made/images/0005.png", "mine");
    const auto before = tree("made");
    const Result clash = call("synth", synth + "6 --overwrite");
    EXPECT_EQ(clash.code, 2) << clash;
    EXPECT_EQ(tree("made"), before);
    for (const auto& entry : fs::directory_iterator(folder_))
        EXPECT_EQ(entry.path().string().find(".partial-"), std::string::npos) << entry.path();
}

TEST_F(BadEnds, RunsAndScenesDoNotReplaceEachOther) {
    ASSERT_EQ(
        call("synth", "--shape torus --out other --views 4 --width 32 --height 24 --quiet").code,
        0);
    const auto scene = tree("other"), run = tree("run");
    for (const char* more : {"", "--overwrite", "--resume"}) {
        const Result r = train("other", more);
        EXPECT_EQ(r.code, 2) << more << ": " << r;
        EXPECT_EQ(tree("other"), scene) << more;
    }
    EXPECT_EQ(call("synth", "--out run --views 4 --overwrite").code, 2);
    EXPECT_EQ(tree("run"), run);
}

TEST_F(BadEnds, APictureBesideAMeshStays) {
    write("beside/x.png", "mine");
    const Result r =
        call("extract-mesh", "--model run --device cpu --mesh-resolution 48 --out beside/x.ply");
    EXPECT_EQ(r.code, 0) << r;
    EXPECT_EQ(contents(folder_ / "beside/x.png"), "mine");
}

TEST_F(BadEnds, PhotographsAreNotReplaced) {
    const auto before = tree("scene");
    const std::string mesh = "--model run --device cpu --mesh-resolution 48 --out ";
    for (const std::string out : {"scene/images/0000.png", "scene/images/0000.ply",
                                  "scene/masks/new/mesh.ply", "scene/images/../images/m.ply"}) {
        const Result r = call("extract-mesh", mesh + out);
        EXPECT_EQ(r.code, 2) << out << ": " << r;
    }
    EXPECT_EQ(call("init", "--scene scene --device cpu --out scene/images/c.ply").code, 2);
    EXPECT_EQ(train("scene/images/run").code, 2);
    EXPECT_EQ(tree("scene"), before);
    const Result r = call("extract-mesh", mesh + "o.stl");
    EXPECT_EQ(r.code, 2);
    EXPECT_TRUE(r.says("unknown ending .stl; use .glb, .obj or .ply")) << r;
    EXPECT_EQ(call("init", "--scene scene --device cpu --out c.txt").code, 2);
    EXPECT_FALSE(fs::exists(folder_ / "o.stl"));
}

TEST_F(BadEnds, ReportsNeverFailARun) {
    fs::copy(folder_ / "run", folder_ / "broken", fs::copy_options::recursive);
    write("broken/mesh/mesh.ply", "ply\nthis is none");
    write("broken/eval/other.json", "{");
    const Result r = call("train", "--resume broken --iterations 22 --device cpu");
    EXPECT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("missing from the report: a mesh")) << r;
    EXPECT_NE(contents(folder_ / "broken/report.json").find("\"done\""), std::string::npos);
    EXPECT_TRUE(fs::exists(folder_ / "broken/point_cloud/iteration_22/point_cloud.ply"));
    // A folder in its place: the page is not even written.
    fs::remove(folder_ / "broken/report.html");
    write("broken/report.html/mine.txt", "mine");
    const Result unwritable = call("train", "--resume broken --iterations 24 --device cpu");
    EXPECT_EQ(unwritable.code, 0) << unwritable;
    EXPECT_TRUE(unwritable.says("there is no report")) << unwritable;
}

TEST_F(BadEnds, ReportsFollowTheMeshAndTheScores) {
    fs::copy(folder_ / "run", folder_ / "grown", fs::copy_options::recursive);
    const auto report = [] { return contents(folder_ / "grown/report.json"); };
    EXPECT_EQ(report().find("\"mesh\": {\"faces\""), std::string::npos);
    ASSERT_EQ(call("extract-mesh", "--model grown --device cpu --mesh-resolution 48").code, 0);
    EXPECT_NE(report().find("\"mesh\": {\"faces\""), std::string::npos);
    const Result scored = call("eval",
                               "geometry --pred grown/mesh/mesh.glb --gt scene/gt/points.ply --tau "
                               "0.1 --out grown/eval/own.json");
    ASSERT_EQ(scored.code, 0) << scored;
    EXPECT_NE(report().find("\"own\""), std::string::npos);
}

TEST_F(BadEnds, AMeshWithoutFacesIsNoResult) {
    const Result empty = call("extract-mesh",
                              "--model run --device cpu --mesh-resolution 48 --alpha-min 1 --out "
                              "empty.ply");
    EXPECT_EQ(empty.code, 7) << empty;
    EXPECT_TRUE(empty.says("with coverage below 1")) << empty;
    EXPECT_FALSE(fs::exists(folder_ / "empty.ply"));
}

TEST_F(BadEnds, ARunThatEndsWorseThanItWasSaysSo) {
    const std::string flags =
        "--config " TVSGS_SOURCE_DIR
        "/configs/3dgs.json --set densify.from=0 --set densify.until=100 --set densify.every=1000 "
        "--set densify.trim_every=1000 --eval-every 10 --iterations 60 ";
    const Result reset = train("reset", flags + "--set densify.opacity_reset_every=58");
    EXPECT_EQ(reset.code, 0) << reset;
    EXPECT_TRUE(reset.says("dB at the end: the training was too long")) << reset;
    const Result steady = train("steady", flags);
    EXPECT_EQ(steady.code, 0) << steady;
    EXPECT_FALSE(steady.says("dB at the end")) << steady;
}

TEST_F(BadEnds, AShortenedScheduleEndsNearItsBestAndMoreGivesNoLess) {
    // Planned for a cloud that covers nothing, so that splats grow.
    ASSERT_EQ(call("synth",
                   "--out wide --views 8 --test-views 2 --width 64 --height 48 --arc 150 --points "
                   "300 --quiet")
                  .code,
              0);
    constexpr double kSlack = 0.5;  // dB
    double before = 14;             // of the shortest run
    for (const int iterations : {50, 491, 1200, 1400}) {
        SCOPED_TRACE(iterations);
        fs::remove_all(folder_ / "short");
        const Result r =
            call("train",
                 "--scene wide --split train_all --set init.min_points=0 --set plan.coverage=0 "
                 "--device cpu --quiet --eval-every 100 --out short --iterations " +
                     std::to_string(iterations));
        ASSERT_EQ(r.code, 0) << r;
        std::istringstream log(contents(folder_ / "short/log.jsonl"));
        double best = 0, last = 0;
        for (std::string line; std::getline(log, line);)
            if (const auto at = line.find("\"psnr\": "); at != std::string::npos)
                last = std::stod(line.substr(at + 8)), best = std::max(best, last);
        EXPECT_GT(last, best - kSlack);
        EXPECT_GT(last, before - kSlack);
        before = last;
    }
}

TEST_F(BadEnds, OnlyRegularFilesAreRead) {
    ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
    fs::create_symlink("loop", folder_ / "loop");
    for (const std::string file : {"/dev/zero", "pipe"}) {
        const Result config = train("endless", "--config " + file),
                     cloud = train("endless", "--init-ply " + file),
                     mesh = call("eval", "geometry --gt scene/gt/mesh.ply --pred " + file);
        EXPECT_EQ(config.code, 2) << config;
        EXPECT_EQ(cloud.code, 3) << cloud;
        EXPECT_EQ(mesh.code, 3) << mesh;
        for (const Result& r : {config, cloud, mesh})
            EXPECT_TRUE(r.says("expected a regular file")) << r;
    }
    for (const std::string use :
         {"train --scene loop --out endless", "train --scene scene --out loop/run",
          "eval geometry --pred loop --gt loop", "extract-mesh --model loop --device cpu"}) {
        const Result r = call(use.substr(0, use.find(' ')), use.substr(use.find(' ')));
        EXPECT_NE(r.code, 0) << use;
        EXPECT_NE(r.code, 1) << use << ": " << r;
    }
    fs::copy(folder_ / "scene", folder_ / "listless", fs::copy_options::recursive);
    write("listless/splits.json", R"({"train_all": [], "test": ["0000.png"]})");
    const Result r = call("train", "--scene listless --split train_all --out endless" + kTrain);
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("list 'train_all' is empty")) << r;
    EXPECT_FALSE(fs::exists(folder_ / "endless"));
}

TEST_F(BadEnds, AFinishedRunHasNoSplatsOfWhereItWasStopped) {
    const auto splats = [] {
        int folders = 0;
        for (const auto& entry : fs::directory_iterator(folder_ / "stopped/point_cloud"))
            folders += entry.is_directory();
        return folders;
    };
    const Result stopped = run_script(
        folder_, "exec 2>err.txt; " TVSGS_BIN_DIR
                 "/tvsgs-train --scene scene --split train_3 --device cpu --set tv.k=20 "
                 "--iterations 5000 --out stopped & p=$!; until [ -s stopped/log.jsonl ]; do sleep "
                 "0.02; done; kill -INT $p; wait $p");
    ASSERT_EQ(stopped.code, 130) << stopped;
    EXPECT_EQ(splats(), 1);
    const std::string log = contents(folder_ / "stopped/log.jsonl"),
                      event = "\"event\": \"stopped\", \"iteration\": ";
    const std::size_t at = log.find(event);
    ASSERT_NE(at, std::string::npos) << log;
    const std::string end = std::to_string(std::stoi(log.substr(at + event.size())) + 20);
    const Result r = call("train", "--resume stopped --device cpu --iterations " + end);
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_EQ(splats(), 1);
    EXPECT_TRUE(
        fs::exists(folder_ / "stopped/point_cloud" / ("iteration_" + end) / "point_cloud.ply"));
}

TEST_F(BadEnds, ARunThatStartsAgainKeepsItsPlan) {
    ASSERT_TRUE(fs::exists(folder_ / "run/plan.json")) << "made by the plan";
    fs::copy(folder_ / "run", folder_ / "again", fs::copy_options::recursive);
    // As if killed before the first checkpoint.
    for (const char* folder : {"checkpoints", "point_cloud"})
        fs::remove_all(folder_ / "again" / folder);
    const std::string plan = contents(folder_ / "again/plan.json");
    const Result r = call("train", "--out again --resume --iterations 3 --device cpu");
    EXPECT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("no checkpoint yet")) << r;
    EXPECT_EQ(contents(folder_ / "again/plan.json"), plan);
}

}  // namespace
}  // namespace tvsgs
