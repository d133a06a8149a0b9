// tvsgs-blocks on a small wide scene: splits, trains and merges it.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

#include "core/device/device.h"
#include "io/splats/ply.h"
#include "pipeline/blocks/blocks_folder.h"
#include "support/command.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr int kBlocks = 3;

class BlocksCommand : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_blocks_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        ASSERT_EQ(bin("tvsgs-synth --out scene --wide 5 --views 14 --test-views 2 --width 64 "
                      "--height 48 --points 3000 --quiet")
                      .code,
                  0);
        std::ofstream(folder_ / "config.json") << R"({
            "scene": {"path": "scene", "split": "train_all"},
            "iterations": 60, "backbone": "ewa", "init": {"min_points": 0},
            "loss": {"tv_normal": {"weight": 0.05}, "tv_position": {"weight": 0.05}},
            "tv": {"k": 20, "refresh_every": 25},
            "densify": {"from": 20, "every": 15, "max_gaussians": 4500}})";
        ASSERT_EQ(bin("tvsgs-train --device cpu --config config.json --out coarse --quiet").code,
                  0);
        const Result split =
            bin("tvsgs-blocks split --coarse coarse --out blocks --blocks 3 "
                "--margin 0.4 --device cpu");
        ASSERT_EQ(split.code, 0) << split;
        for (int block = 1; block <= kBlocks; ++block) {
            const Result run = train("blocks", block);
            ASSERT_EQ(run.code, 0) << run;
            EXPECT_FALSE(run.says("tvsgs-extract-mesh")) << "blocks come first: " << run;
        }
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static Result bin(const std::string& line) {
        return run_script(folder_,
                          "OMP_NUM_THREADS=2 " TVSGS_BIN_DIR "/" + line + " >out.txt 2>err.txt");
    }
    static Result train(const std::string& blocks, int block, const std::string& more = "") {
        return bin("tvsgs-blocks run --blocks " + blocks + " --block " + std::to_string(block) +
                   " --device cpu " + more);
    }
    /// A copy of the blocks that a test may damage.
    static std::string copy(const std::string& name) {
        fs::remove_all(folder_ / name);
        fs::copy(folder_ / "blocks", folder_ / name, fs::copy_options::recursive);
        return name;
    }
    /// A copy of the blocks before training.
    static void copy_untrained(const std::string& name) {
        copy(name);
        for (int b = 1; b <= kBlocks; ++b) {
            fs::remove_all(block(name, b) / "run");
            fs::remove(block(name, b) / "done.json");
        }
    }
    static fs::path block(const std::string& blocks, int number) {
        return folder_ / blocks / BlocksManifest::block_name(number);
    }
    static fs::path splats(const std::string& blocks, int number) {
        return block(blocks, number) / "run/point_cloud/iteration_60/point_cloud.ply";
    }
    /// The largest distance from their mean of the first `most` cameras of a run.
    static double spread(const std::string& run, std::size_t most) {
        const json cameras = json::parse(contents(folder_ / run / "cameras.json"));
        const std::size_t n = std::min(most, cameras.size());
        std::vector<Vec3d> places;
        Vec3d mean;
        for (std::size_t i = 0; i < n; ++i) {
            const json& p = cameras[i]["position"];
            places.push_back({p[0], p[1], p[2]});
            mean += places.back() / static_cast<double>(n);
        }
        double largest = 0;
        for (const Vec3d& p : places) largest = std::max(largest, norm(p - mean));
        return largest;
    }
    static std::string output() { return contents(folder_ / "out.txt"); }
    static void expect_message(const Result& result,
                               int code,
                               std::initializer_list<const char*> parts) {
        EXPECT_EQ(result.code, code) << result;
        const std::string said = contents(folder_ / "err.txt");
        for (const char* part : parts)
            EXPECT_NE(said.find(part), std::string::npos) << said << "\nlacks " << part;
    }

    static inline fs::path folder_;
};

TEST_F(BlocksCommand, SplitWritesWhatBatchSystemsTake) {
    const BlocksManifest manifest = read_manifest(folder_ / "blocks");
    ASSERT_EQ(manifest.count(), kBlocks);
    EXPECT_EQ(manifest.margin, 0.4);
    std::istringstream commands(contents(folder_ / "blocks/commands.txt"));
    int lines = 0;
    for (std::string line; std::getline(commands, line);)
        EXPECT_EQ(line, "tvsgs-blocks run --blocks " + (folder_ / "blocks").string() + " --block " +
                            std::to_string(++lines));
    EXPECT_EQ(lines, kBlocks);
    for (int b = 1; b <= kBlocks; ++b) {
        const BlockInputs inputs = read_block_inputs(manifest, b);
        EXPECT_GE(inputs.views, 2);
        EXPECT_GT(inputs.points, 100);
        EXPECT_GT(inputs.fixed_splats, 0);
        // Points are in the cell and its margin; fixed splats are not.
        const GroundCell& cell = manifest.cells[static_cast<std::size_t>(b - 1)];
        for (const Vec3f p : read_ply(block("blocks", b) / "points.ply").points.positions)
            EXPECT_LT(cell.distance(manifest.frame.on_ground(vec_cast<double>(p))), 0.4001);
        const Gaussians<Cpu> fixed = read_splat_ply(block("blocks", b) / "fixed.ply");
        for (const Vec3f p : to_host(fixed.means)) {
            if (manifest.block_of(vec_cast<double>(p)) == 0) continue;
            EXPECT_GE(cell.distance(manifest.frame.on_ground(vec_cast<double>(p))), 0.3999);
        }
    }
    // The settings of a block are the coarse run's, except those of views.
    const json config = json::parse(contents(block("blocks", 1) / "config.json"));
    EXPECT_EQ(config["iterations"], 60);
    EXPECT_EQ(config["scene"]["split"], "");
    EXPECT_EQ(config["plan"]["enabled"], false);
    // Rates in scene extents use the extent of the whole.
    const double whole =
        json::parse(contents(folder_ / "blocks/config.json"))["lr"]["position_start"];
    const double ratio = spread("coarse", 12) / spread("blocks/block_001/run", 1000);
    EXPECT_NEAR(config["lr"]["position_start"], whole * ratio, 1e-5 * whole);
}

TEST_F(BlocksCommand, StatusSaysWhatIsLeft) {
    EXPECT_EQ(bin("tvsgs-blocks status blocks").code, 0);
    EXPECT_NE(output().find("block 3    done"), std::string::npos) << output();
    EXPECT_EQ(bin("tvsgs-blocks status --blocks blocks --missing").code, 0);
    EXPECT_EQ(output(), "");
    const std::string some = copy("some");
    fs::remove_all(block(some, 1) / "run");
    fs::remove(block(some, 1) / "done.json");
    fs::remove(block(some, 2) / "done.json");
    EXPECT_EQ(bin("tvsgs-blocks status some").code, 3);
    EXPECT_NE(output().find("block 1    waiting"), std::string::npos) << output();
    EXPECT_NE(output().find("block 2    stopped   iteration 60"), std::string::npos) << output();
    EXPECT_EQ(bin("tvsgs-blocks status some --missing").code, 3);
    EXPECT_EQ(output(), "1-2\n");
    EXPECT_EQ(bin("tvsgs-blocks status some --json").code, 3);
    EXPECT_EQ(json::parse(output())[2]["state"], "done");
}

TEST_F(BlocksCommand, MergeKeepsEachPlaceOnce) {
    ASSERT_EQ(bin("tvsgs-blocks merge blocks --fade 0 --out whole").code, 0)
        << contents(folder_ / "err.txt");
    const BlocksManifest manifest = read_manifest(folder_ / "blocks");
    const Gaussians<Cpu> whole =
        read_splat_ply(folder_ / "whole/point_cloud/iteration_60/point_cloud.ply");
    int own = 0;
    for (int b = 1; b <= kBlocks; ++b)
        for (const Vec3f p : to_host(read_splat_ply(splats("blocks", b)).means))
            own += manifest.block_of(vec_cast<double>(p)) == b;
    int far = 0;
    for (const Vec3f p : to_host(read_splat_ply(folder_ / "blocks/coarse.ply").means))
        far += manifest.block_of(vec_cast<double>(p)) == 0;
    EXPECT_EQ(whole.size(), own + far);
    EXPECT_GT(own, 500);
    // Ordered by block, far ones last.
    int last = 1;
    for (const Vec3f p : to_host(whole.means)) {
        const int b = manifest.block_of(vec_cast<double>(p));
        EXPECT_GE(b == 0 ? kBlocks + 1 : b, last);
        last = b == 0 ? kBlocks + 1 : b;
    }
    const json cameras = json::parse(contents(folder_ / "whole/cameras.json"));
    EXPECT_EQ(cameras.size(), 12u);

    // It is a run like any other, replaced only on request.
    EXPECT_EQ(bin("tvsgs-extract-mesh --model whole --device cpu --mesh-resolution 64 "
                  "--voxel-size 0.1 --out whole/mesh/mesh.ply --no-preview")
                  .code,
              0)
        << contents(folder_ / "err.txt");
    const std::string again = "tvsgs-blocks merge blocks --fade 0 --out whole";
    EXPECT_EQ(bin(again).code, 2);
    const std::string before = contents(folder_ / "whole/point_cloud/iteration_60/point_cloud.ply");
    EXPECT_EQ(bin(again + " --overwrite").code, 0);
    EXPECT_EQ(contents(folder_ / "whole/point_cloud/iteration_60/point_cloud.ply"), before);
    // By default, splats of both sides meet at the cuts.
    EXPECT_EQ(bin("tvsgs-blocks merge blocks --out faded").code, 0);
    EXPECT_GT(read_splat_ply(folder_ / "faded/point_cloud/iteration_60/point_cloud.ply").size(),
              whole.size() + 20);
}

TEST_F(BlocksCommand, MergeRefusesWhatIsMissingDamagedOrOfAnotherVersion) {
    const std::string bad = copy("bad");
    const auto merge = [] { return bin("tvsgs-blocks merge bad --out none"); };
    fs::remove(block(bad, 2) / "done.json");
    expect_message(merge(), 3, {"block 2", "done.json)", "run bad --block 2"});
    fs::copy(block("blocks", 2) / "done.json", block(bad, 2) / "done.json");
    {
        std::fstream file(splats(bad, 2), std::ios::in | std::ios::out | std::ios::binary);
        file.seekp(-5, std::ios::end);
        file.put('x');
    }
    expect_message(merge(), 3, {"block 2", "point_cloud.ply is damaged", "--block 2 --again"});
    fs::resize_file(splats(bad, 2), 100);
    expect_message(merge(), 3, {"block 2", "100 bytes, expected"});
    copy("bad");
    json done = json::parse(contents(block(bad, 3) / "done.json"));
    done["version"] = 3;
    std::ofstream(block(bad, 3) / "done.json") << done;
    expect_message(merge(), 3, {"block_003/done.json", "version 3", "--block 3 --again"});
    copy("bad");
    std::ofstream(folder_ / "bad/coarse.ply", std::ios::app) << "x";
    expect_message(merge(), 3, {"coarse.ply is damaged", "split again"});
    expect_message(bin("tvsgs-blocks merge scene --out none"), 3, {"manifest.json"});
    EXPECT_FALSE(fs::exists(folder_ / "none"));
}

TEST_F(BlocksCommand, SingleBlocksRunAgainWithTheSameBits) {
    copy("again");
    const std::string before = contents(splats("again", 2));
    const auto written = fs::last_write_time(splats("again", 2));
    expect_message(train("again", 2), 0, {"--again trains it again"});
    EXPECT_EQ(fs::last_write_time(splats("again", 2)), written);
    EXPECT_EQ(train("again", 2, "--again").code, 0);
    EXPECT_NE(fs::last_write_time(splats("again", 2)), written);
    EXPECT_EQ(contents(splats("again", 2)), before);

    // Damaged results do not count as done; damaged inputs are not trained on.
    std::ofstream(splats("again", 2), std::ios::app) << "x";
    expect_message(train("again", 2), 3, {"block 2", "is damaged", "--again"});
    std::ofstream(block("again", 2) / "points.ply", std::ios::app) << "x";
    expect_message(train("again", 2, "--again"), 3, {"block 2", "points.ply is damaged"});
    EXPECT_EQ(train("again", 9).code, 2);
    EXPECT_EQ(train("again", 0).code, 2);
}

TEST_F(BlocksCommand, WhatIsRefusedLeavesBlocksAsTheyWere) {
    copy("safe");
    const auto files = [] {
        std::map<std::string, std::string> all;
        for (const auto& file : fs::recursive_directory_iterator(folder_ / "safe"))
            if (file.is_regular_file()) all[file.path()] = contents(file.path());
        return all;
    };
    const auto before = files();
    expect_message(train("safe", 1, "--again --set nosuch=3"), 2, {"block 1", "nosuch"});
    expect_message(train("safe", 1, "--again --set model.sh_degree=9"), 2, {"model.sh_degree"});
    expect_message(train("safe", 1, "--again --scene nowhere"), 3, {"nowhere"});
    for (const char* out : {"safe", "safe/block_001/run", "safe/merged", "./safe/../safe/run"})
        expect_message(bin(std::string("tvsgs-blocks merge safe --overwrite --out ") + out), 2,
                       {"lies inside the folder of the blocks"});
    expect_message(bin("tvsgs-eval geometry --pred scene/gt/mesh.ply --gt scene/gt/mesh.ply --out "
                       "safe/manifest.json"),
                   2, {"safe/manifest.json", "choose another"});
    EXPECT_EQ(files(), before);
    expect_message(bin("tvsgs-blocks merge safe --out none --fade nan"), 2, {"--fade", "nan"});
    expect_message(bin("tvsgs-blocks split --coarse coarse --coarse-splats 9 --out x --blocks 2"),
                   2, {"--coarse-splats"});
    EXPECT_FALSE(fs::exists(folder_ / "none"));
}

TEST_F(BlocksCommand, AMergedRunFindsItsSceneFromElsewhere) {
    fs::create_directories(folder_ / "a/b");
    const Result split = run_script(
        folder_, "cd a/b && " TVSGS_BIN_DIR
                 "/tvsgs-blocks split --scene ../../scene --coarse ../../coarse --out ../../far "
                 "--blocks 1 --iterations 90 --device cpu >../../out.txt 2>../../err.txt");
    ASSERT_EQ(split.code, 0) << split;
    const json config = json::parse(contents(folder_ / "far/config.json"));
    EXPECT_EQ(config["iterations"], 90);
    EXPECT_EQ(config["densify"]["from"], 30);  // 20 of 60 iterations: the schedule is fitted
    ASSERT_EQ(train("far", 1).code, 0) << contents(folder_ / "err.txt");
    ASSERT_EQ(bin("tvsgs-blocks merge far --out of_far").code, 0);
    const std::string scene =
        json::parse(contents(folder_ / "of_far/config.json"))["scene"]["path"];
    EXPECT_TRUE(fs::equivalent(scene, folder_ / "scene")) << scene;
    // A merged run has no checkpoint, so it cannot be resumed; nothing is lost.
    expect_message(bin("tvsgs-train --resume of_far --iterations 99 --device cpu"), 2,
                   {"no checkpoint", "--overwrite"});
    EXPECT_TRUE(fs::exists(folder_ / "of_far/point_cloud/iteration_90/point_cloud.ply"));
}

TEST_F(BlocksCommand, StoppedBlocksGoOnAndTwoAtOnceAreRefused) {
    copy("stop");
    const std::string before = contents(splats("stop", 1));
    fs::remove_all(block("stop", 1) / "run");
    fs::remove(block("stop", 1) / "done.json");
    {
        const int lock = ::open(block("stop", 1).c_str(), O_RDONLY | O_DIRECTORY);
        ASSERT_EQ(::flock(lock, LOCK_EX), 0);
        expect_message(train("stop", 1), 2, {"block 1", "another tvsgs-blocks"});
        EXPECT_EQ(bin("tvsgs-blocks status stop").code, 3);
        EXPECT_NE(output().find("block 1    training"), std::string::npos) << output();
        ::close(lock);
    }
    // Stopped during training, with a checkpoint.
    const Result stopped = run_script(
        folder_, "{ OMP_NUM_THREADS=1 " TVSGS_BIN_DIR
                 "/tvsgs-blocks run stop --block 1 --device cpu >out.txt 2>err.txt & pid=$!; for i "
                 "in $(seq 600); do grep -q '\"iteration\": 1,' stop/block_001/run/log.jsonl "
                 "2>/dev/null && break; sleep 0.05; done; kill -TERM $pid; wait $pid; }");
    if (stopped.code != 0) {  // otherwise it was faster than the signal
        EXPECT_EQ(stopped.code, 143) << stopped;
        EXPECT_FALSE(fs::exists(block("stop", 1) / "done.json"));
        EXPECT_EQ(bin("tvsgs-blocks status stop --missing").code, 3);
        EXPECT_EQ(output(), "1\n");
    }
    EXPECT_EQ(train("stop", 1).code, 0) << contents(folder_ / "err.txt");
    EXPECT_EQ(contents(splats("stop", 1)), before);
    EXPECT_EQ(bin("tvsgs-blocks status stop").code, 0);
}

TEST_F(BlocksCommand, AllBlocksTrainSideBySideAndAFailedOneRunsAgain) {
    copy_untrained("all");
    // Another process holds block 2 until the first attempt has failed. Closed in the command's
    // processes, which would inherit the lock.
    const int lock = ::open(block("all", 2).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    ASSERT_EQ(::flock(lock, LOCK_EX), 0);
    std::thread release([lock] {
        while (contents(block("all", 2) / "train.log").find("error:") == std::string::npos)
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
        ::close(lock);
    });
    const Result run = bin("tvsgs-blocks run all --jobs 2");
    release.join();
    expect_message(run, 0,
                   {"Block 2 failed on cpu", "exit code 2: error: block 2: another tvsgs-blocks",
                    "Block 2 is done, 3 of 3", "    tvsgs-blocks merge all"});
    for (int b = 1; b <= kBlocks; ++b) {
        EXPECT_EQ(contents(splats("all", b)), contents(splats("blocks", b)));
        const std::string log = contents(block("all", b) / "train.log");
        EXPECT_NE(log.find("of 3 is done: "), std::string::npos) << log;
        EXPECT_EQ(log.find("\"iteration\""), std::string::npos) << log;
    }
    expect_message(bin("tvsgs-blocks run all --jobs 2"), 0, {"All 3 blocks are done, 0 of them"});
}

TEST_F(BlocksCommand, AllBlocksStopBySignalAndGoOn) {
    copy_untrained("halt");
    // Two blocks train and one waits when the signal arrives.
    const Result stopped = run_script(
        folder_, "{ OMP_NUM_THREADS=2 " TVSGS_BIN_DIR
                 "/tvsgs-blocks run halt --jobs 2 --progress json >out.txt 2>err.txt & pid=$!; for "
                 "i in $(seq 1200); do grep -q '\"block\": 1' err.txt && break; sleep 0.05; done; "
                 "kill -TERM $pid; wait $pid; }");
    EXPECT_EQ(stopped.code, 143) << stopped;
    EXPECT_TRUE(stopped.says("\"iteration\": 1,")) << stopped;
    EXPECT_TRUE(stopped.says("of 3 blocks are done; the same command")) << stopped;
    EXPECT_FALSE(fs::exists(block("halt", 3) / "run"));
    EXPECT_EQ(bin("tvsgs-blocks status halt --missing").code, 3);
    expect_message(bin("tvsgs-blocks run halt --jobs 2"), 0, {"All 3 blocks are done"});
    for (int b = 1; b <= kBlocks; ++b)
        EXPECT_EQ(contents(splats("halt", b)), contents(splats("blocks", b)));
}

TEST_F(BlocksCommand, ABlockThatFailsTwiceLeavesItsCode) {
    copy("gone");
    fs::remove_all(block("gone", 2));
    fs::remove(block("gone", 3) / "done.json");
    expect_message(bin("tvsgs-blocks run gone --jobs 2"), 3,
                   {"block_002 is missing; run tvsgs-blocks split again", "Block 3 is done, 1 of 2",
                    "gone: 2 of 3 blocks are done; block 2 failed twice"});
}

TEST_F(BlocksCommand, RunRefusesWordsThatDoNotGoTogether) {
    const auto run = [](const std::string& words) {
        return bin("tvsgs-blocks run blocks " + words);
    };
    expect_message(run(""), 2, {"--block N", "--gpus all", "--jobs N"});
    expect_message(run("--jobs 2 --gpus 0"), 2, {"--gpus"});
    expect_message(run("--jobs 2 --block 1"), 2, {"--block"});
    expect_message(run("--jobs 2 --again"), 2, {"--again"});
    expect_message(run("--jobs 2 --device cpu"), 2, {"--device"});
    expect_message(run("--jobs 0"), 2, {"--jobs"});
    expect_message(run("--jobs 2 --set nosuch=3"), 2, {"nosuch"});
    expect_message(run("--jobs 2 --scene nowhere"), 3, {"nowhere"});
    if (!kHasCuda) expect_message(run("--gpus all"), 5, {"--gpus all: this build has no CUDA"});
    const int lock = ::open((folder_ / "blocks").c_str(), O_RDONLY | O_DIRECTORY);
    ASSERT_EQ(::flock(lock, LOCK_EX), 0);
    expect_message(run("--jobs 2"), 2, {"blocks: another tvsgs-blocks run"});
    ::close(lock);
}

TEST_F(BlocksCommand, SlurmTasksTrainABlockEach) {
    ASSERT_EQ(bin("tvsgs-blocks slurm blocks").code, 0) << contents(folder_ / "err.txt");
    const std::string job = output();
    for (const char* part :
         {"#SBATCH --array=1-3\n", "#SBATCH --gres=gpu:1\n", "#SBATCH --requeue\n",
          "#SBATCH --open-mode=append\n", "/blocks\"/block_%3a/train.log\n", "--device cuda"})
        EXPECT_NE(job.find(part), std::string::npos) << job << "lacks " << part;
    ASSERT_EQ(bin("tvsgs-blocks slurm blocks --device cpu").code, 0);
    EXPECT_EQ(output().find("gpu"), std::string::npos) << output();
    fs::copy(folder_ / "out.txt", folder_ / "job.sh");
    expect_message(run_script(folder_, "PATH=" TVSGS_BIN_DIR
                                       ":$PATH SLURM_ARRAY_TASK_ID=2 sh job.sh --set tv.k=21 "
                                       ">out.txt 2>err.txt"),
                   0, {"Block 2 is done"});
}

TEST_F(BlocksCommand, RefusesWhatCannotBe) {
    expect_message(bin("tvsgs-blocks split --coarse coarse --out blocks --blocks 2"), 2,
                   {"holds a split scene"});
    expect_message(bin("tvsgs-blocks split --coarse coarse --out scene --blocks 2"), 2,
                   {"is not empty"});
    EXPECT_TRUE(fs::exists(folder_ / "scene/sparse/0/images.txt"));  // nothing of it was removed
    expect_message(bin("tvsgs-blocks split --coarse coarse --out x"), 2, {"--max-splats"});
    expect_message(bin("tvsgs-blocks split --out x --blocks 2"), 2, {"--coarse"});
    expect_message(bin("tvsgs-blocks split --coarse coarse --out x --blocks 2 --up 0,0"), 2,
                   {"--up"});
    EXPECT_EQ(bin("tvsgs-blocks split --coarse none --out x --blocks 2").code, 3);
    // A scene other than the one that was split.
    ASSERT_EQ(
        bin("tvsgs-synth --out other --views 4 --width 32 --height 24 --points 500 --quiet").code,
        0);
    expect_message(bin("tvsgs-blocks split --coarse coarse --scene other --out x --blocks 2"), 3,
                   {"other: not the scene of coarse"});
    copy("moved");
    fs::remove(block("moved", 1) / "done.json");
    expect_message(train("moved", 1, "--scene other"), 3, {"other images or cameras"});
}

// Without a coarse run, split trains one; the number of blocks follows from the splats per block.
TEST_F(BlocksCommand, SplitTrainsTheCoarseRunItself) {
    const Result split =
        bin("tvsgs-blocks split --scene scene --out own --max-splats 5000 --margin 0.3 -r 1 "
            "--coarse-resolution 2 --config config.json --set iterations=30 --device cpu");
    ASSERT_EQ(split.code, 0) << split;
    const BlocksManifest manifest = read_manifest(folder_ / "own");
    EXPECT_GT(manifest.count(), 1);
    const json config = json::parse(contents(folder_ / "own/config.json"));
    EXPECT_EQ(config["scene"]["resolution"], 1);
    const json coarse = json::parse(contents(folder_ / "own/coarse/config.json"));
    EXPECT_EQ(coarse["scene"]["resolution"], 2);
    for (int b = 1; b <= manifest.count(); ++b)
        EXPECT_LE(read_block_inputs(manifest, b).expected_splats, 5000 * 1.2);
}

}  // namespace
}  // namespace tvsgs
