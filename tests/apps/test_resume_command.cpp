// Interrupted, killed and failed runs resume without loss.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "io/files/checkpoint.h"
#include "support/command.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kTrain = TVSGS_BIN_DIR "/tvsgs-train";

class ResumeCommand : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_resume_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        ASSERT_EQ(std::system(("cd '" + folder_.string() +
                               "' && " TVSGS_BIN_DIR
                               "/tvsgs-synth --out scene --views 6 --width 48 --height 36 --quiet")
                                  .c_str()),
                  0);
        // Votes every 10, searches every 25, grows every 15 iterations.
        std::ofstream(folder_ / "config.json") << R"({
            "scene": {"path": "scene", "views": "0,1,2"},
            "iterations": 120, "backbone": "ewa", "init": {"min_points": 0},
            "loss": {"flatten": {"weight": 1}, "tv_normal": {"weight": 0.05},
                     "tv_position": {"weight": 0.05}},
            "tv": {"k": 20, "refresh_every": 25},
            "densify": {"from": 20, "every": 15, "trim_every": 50, "max_gaussians": 4500}})";
        const auto start = std::chrono::steady_clock::now();
        const Result whole = train("--config config.json --out whole");
        whole_us_ = std::chrono::duration_cast<std::chrono::microseconds>(
                        std::chrono::steady_clock::now() - start)
                        .count();
        ASSERT_EQ(whole.code, 0) << whole;
        ASSERT_GT(splats("whole").size(), 100000u);
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static Result shell(const std::string& script) { return run_script(folder_, script); }
    static Result train(const std::string& arguments) {
        return shell(std::string("OMP_NUM_THREADS=1 ") + kTrain + " --device cpu " + arguments +
                     " >out.txt 2>err.txt");
    }

    /// In the background, with messages in err.txt.
    static pid_t start(const std::string& arguments) {
        const pid_t child = ::fork();
        if (child != 0) return child;
        const std::string line =
            std::string("exec ") + kTrain + " --device cpu " + arguments + " 2>err.txt";
        ::setenv("OMP_NUM_THREADS", "1", 1);
        if (::chdir(folder_.c_str()) == 0)
            ::execl("/bin/sh", "sh", "-c", line.c_str(), static_cast<char*>(nullptr));
        ::_exit(127);
    }
    static int wait_for(pid_t child) {
        int status = 0;
        ::waitpid(child, &status, 0);
        return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    template <class Condition>
    static bool until(const Condition& condition) {
        for (int i = 0; i < 1200 && !condition(); ++i) ::usleep(25000);
        return condition();
    }

    static std::string splats(const std::string& run, int iteration = 120) {
        return contents(folder_ / run / "point_cloud" / ("iteration_" + std::to_string(iteration)) /
                        "point_cloud.ply");
    }
    static std::vector<std::string> checkpoints(const std::string& run) {
        std::vector<std::string> names;
        std::error_code code;
        for (const auto& file : fs::directory_iterator(folder_ / run / "checkpoints", code))
            names.push_back(file.path().filename());
        std::sort(names.begin(), names.end());
        return names;
    }
    static std::vector<json> log(const std::string& run) {
        std::vector<json> lines;
        std::istringstream text(contents(folder_ / run / "log.jsonl"));
        for (std::string line; std::getline(text, line);) lines.push_back(json::parse(line));
        return lines;
    }
    static void flip(const fs::path& file, std::streamoff at) {
        std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
        stream.seekg(at);
        const char old = static_cast<char>(stream.get());
        stream.seekp(at);
        stream.put(static_cast<char>(old ^ 16));
    }

    static inline fs::path folder_;
    static inline std::int64_t whole_us_ = 0;  // duration of the uninterrupted run
};

TEST_F(ResumeCommand, TwoHalvesAreTheWhole) {
    Result r = train("--config config.json --out half --iterations 60 --checkpoint-every 25");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_EQ(checkpoints("half"),
              (std::vector<std::string>{"iteration_50.ckpt", "iteration_59.ckpt"}));
    r = train("--resume half --iterations 120 --report-every 10");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(splats("half") == splats("whole"));
    const json config = json::parse(contents(folder_ / "half/config.json"));
    EXPECT_EQ(config.at("iterations"), 120);
    EXPECT_EQ(config.at("info").at("resumed_from"), 59);
    EXPECT_EQ(config.at("info").at("changed"), json({{"iterations", "60 -> 120"}}));
    int last = 0;
    double seconds = 0;
    for (const json& line : log("half")) {
        EXPECT_GE(line.at("iteration"), last) << "nothing of the first half's last iteration";
        EXPECT_GE(line.value("seconds", seconds), seconds) << "the clock goes on";
        last = line.at("iteration"), seconds = line.value("seconds", seconds);
    }
    EXPECT_EQ(last, 120);

    // A checkpoint alone, into a new folder.
    fs::copy(folder_ / "half/checkpoints/iteration_59.ckpt", folder_ / "moved.ckpt");
    r = train("--resume moved.ckpt --out elsewhere --iterations 120");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(splats("elsewhere") == splats("whole"));
}

TEST_F(ResumeCommand, TheSkyGoesAlong) {
    Result r = train(
        "--config config.json --set loss.photometric.background=sky --iterations 40 "
        "--checkpoint-every 20 --out sky");
    ASSERT_EQ(r.code, 0) << r;
    const std::string point = "--resume sky/checkpoints/iteration_20.ckpt --out sky_on ";
    r = train(point);
    ASSERT_EQ(r.code, 0) << r;
    const std::string ply = "/point_cloud/iteration_40/point_cloud.ply";
    EXPECT_TRUE(contents(folder_ / ("sky" + ply)) == contents(folder_ / ("sky_on" + ply)));
    EXPECT_TRUE(contents(folder_ / "sky/sky.png") == contents(folder_ / "sky_on/sky.png"));
    fs::remove(folder_ / "sky/sky.png");
    r = train(point + "--overwrite");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_NE(contents(folder_ / "err.txt").find("no sky.png"), std::string::npos);
}

TEST_F(ResumeCommand, ChangesAreAppliedAndRecorded) {
    ASSERT_EQ(train("--config config.json --out changed --iterations 30").code, 0);
    Result r = train("--resume changed --iterations 40 --set lr.scale=0.02 --set tv.k=15");
    ASSERT_EQ(r.code, 0) << r;
    const json changes{
        {"iterations", "30 -> 40"}, {"lr.scale", "0.005 -> 0.02"}, {"tv.k", "20 -> 15"}};
    EXPECT_EQ(json::parse(contents(folder_ / "changed/config.json")).at("info").at("changed"),
              changes);
    for (const json& line : log("changed"))
        if (line.value("event", "") == "resumed") {
            EXPECT_EQ(line.at("changed"), changes);
        }
    ASSERT_EQ(train("--config config.json --out unchanged --iterations 40").code, 0);
    EXPECT_FALSE(splats("changed", 40) == splats("unchanged", 40));
    // The changed settings are kept.
    r = train("--resume changed --iterations 50");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_EQ(json::parse(contents(folder_ / "changed/config.json")).at("tv").at("k"), 15);

    const int before = static_cast<int>(checkpoints("changed").size());
    r = train("--resume changed --iterations 20");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("already trained for 49 iterations")) << r;
    EXPECT_EQ(static_cast<int>(checkpoints("changed").size()), before);
}

TEST_F(ResumeCommand, WhatIsRefusedLeavesTheRunAsItWas) {
    ASSERT_EQ(train("--config config.json --out kept --iterations 20").code, 0);
    ASSERT_EQ(train("--config config.json --out posed --iterations 20 --refine-cameras").code, 0);
    const auto expect_refused = [](const std::string& run, const std::string& setting) {
        const auto texts = [&] {
            return contents(folder_ / run / "config.json") + contents(folder_ / run / "log.jsonl");
        };
        const std::string before = texts();
        const auto points = checkpoints(run);
        for (const char* out : {"", " --out anew"}) {
            const Result r = train("--resume " + run + " --iterations 30 --set " + setting + out);
            EXPECT_EQ(r.code, 2) << r;
            EXPECT_TRUE(r.says(setting.substr(0, setting.find('=')))) << r;
        }
        EXPECT_EQ(texts(), before) << setting;
        EXPECT_EQ(checkpoints(run), points) << setting;
        EXPECT_FALSE(fs::exists(folder_ / "anew")) << setting;
        const Result r = train("--resume " + run + " --iterations 30");
        EXPECT_EQ(r.code, 0) << "goes on as if nothing had been asked: " << r;
    };
    expect_refused("kept", "model.sh_degree=1");
    expect_refused("posed", "cameras.refine=false");
}

TEST_F(ResumeCommand, SparesOnlyWhatTheStateKnows) {
    ASSERT_EQ(train("--config config.json --out bare --iterations 20").code, 0);
    const std::string before = contents(folder_ / "bare/config.json");
    const Result r = train("--resume bare --iterations 30 --set densify.growth_in_gaps_only=0.5");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("densify.growth_in_gaps_only = 0.5")) << r;
    EXPECT_EQ(contents(folder_ / "bare/config.json"), before);
}

TEST_F(ResumeCommand, SignalsSaveACheckpoint) {
    for (const auto& [signal, code] : {std::pair{SIGINT, 130}, {SIGTERM, 143}, {SIGHUP, 129}}) {
        const std::string run = "stopped_" + std::to_string(signal);
        const pid_t child = start("--config config.json --report-every 1 --out " + run);
        EXPECT_TRUE(until([&] { return contents(folder_ / run / "log.jsonl").size() > 2000; }));
        ::kill(child, signal);
        EXPECT_EQ(wait_for(child), code);
        EXPECT_EQ(checkpoints(run).size(), 1u);
        const Result r = train("--resume " + run);
        ASSERT_EQ(r.code, 0) << r;
        EXPECT_TRUE(splats(run) == splats("whole")) << "stopped by signal " << signal;
    }
}

TEST_F(ResumeCommand, ASecondSignalLeavesAtOnce) {
    // A pipe in place of a picture blocks the command there.
    fs::create_directories(folder_ / "twice/test");
    ASSERT_EQ(::mkfifo((folder_ / "twice/test/0000.png").c_str(), 0600), 0);
    const pid_t child = start(
        "--config config.json --eval --iterations 1 --set scene.views= "
        "--out twice");
    EXPECT_TRUE(until([] { return !splats("twice", 1).empty(); }));
    ::usleep(300000);
    ::kill(child, SIGINT);
    ::usleep(300000);
    EXPECT_EQ(::waitpid(child, nullptr, WNOHANG), 0) << "the first signal waits for the picture";
    ::kill(child, SIGINT);
    EXPECT_EQ(wait_for(child), 130);
}

/// Set RESUME_TEST_KILLS=50 for more.
TEST_F(ResumeCommand, KilledTenTimes) {
    const char* seed = std::getenv("RESUME_TEST_SEED");
    std::minstd_rand random(seed != nullptr ? static_cast<unsigned>(std::atoi(seed)) : 1);
    const char* kills_wanted = std::getenv("RESUME_TEST_KILLS");
    const int kills = kills_wanted != nullptr ? std::atoi(kills_wanted) : 10;
    const std::string arguments =
        "--config config.json --quiet --out killed --checkpoint-every 3 --resume";
    int ended = 0;
    for (int i = 0; i < kills; ++i) {
        const pid_t child = start(arguments);
        // Any time from before the start to several checkpoints later.
        ::usleep(static_cast<unsigned>(random() % static_cast<unsigned>(whole_us_ / 2)));
        ::kill(child, SIGKILL);
        ended += wait_for(child) == 0;
        if (ended > 0) {  // finished before it could be killed: start again
            ended = 0;
            EXPECT_TRUE(splats("killed") == splats("whole"));
            fs::remove_all(folder_ / "killed");
        }
    }
    const Result r = train(arguments);
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(splats("killed") == splats("whole"));
    // A run with splats is not started again without a request.
    fs::remove_all(folder_ / "killed/checkpoints");
    const Result refused = train(arguments);
    EXPECT_EQ(refused.code, 2) << refused;
    EXPECT_TRUE(refused.says("has splats but no checkpoint")) << refused;
    EXPECT_TRUE(splats("killed") == splats("whole"));
    EXPECT_EQ(train(arguments + " --overwrite").code, 0);
    // Except if a process was killed before its first checkpoint; foreign files stay.
    for (const char* folder : {"checkpoints", "point_cloud"})
        fs::remove_all(folder_ / "killed" / folder);
    fs::create_directories(folder_ / "killed/point_cloud");
    for (const char* name : {"config.json.tmp-1-0", "point_cloud/a.tmp-1-1"})
        std::ofstream(folder_ / "killed" / name) << "half";
    std::ofstream(folder_ / "killed/notes.tmp-1") << "of the user";
    ASSERT_EQ(train(arguments).code, 0);
    EXPECT_TRUE(fs::remove(folder_ / "killed/notes.tmp-1"));
    for (const auto& file : fs::recursive_directory_iterator(folder_ / "killed"))
        EXPECT_EQ(file.path().string().find(".tmp-"), std::string::npos) << file.path();
}

TEST_F(ResumeCommand, DamagedCheckpoints) {
    Result r = train("--config config.json --out damaged --iterations 40 --checkpoint-every 20");
    ASSERT_EQ(r.code, 0) << r;
    const fs::path older = folder_ / "damaged/checkpoints/iteration_20.ckpt",
                   newer = folder_ / "damaged/checkpoints/iteration_39.ckpt";
    fs::copy(older, folder_ / "older.ckpt");
    flip(newer, 70000);
    r = train("--resume damaged/checkpoints/iteration_39.ckpt --iterations 120");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("the checksum of")) << r;
    fs::resize_file(older, 50000);
    r = train("--resume damaged --iterations 120");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("damaged/checkpoints/iteration_20.ckpt: 50,000 bytes")) << r;
    // The previous checkpoint is valid: resumes from it and removes the damaged one.
    fs::copy(folder_ / "older.ckpt", older, fs::copy_options::overwrite_existing);
    r = train("--resume damaged --iterations 120 --checkpoint-every 0");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("trying the one before")) << r;
    EXPECT_TRUE(splats("damaged") == splats("whole"));
    EXPECT_EQ(checkpoints("damaged"), std::vector<std::string>{"iteration_20.ckpt"});
}

TEST_F(ResumeCommand, AnotherScene) {
    ASSERT_EQ(train("--config config.json --out other --iterations 12").code, 0);
    Result r = train("--resume other --iterations 20 --views 1,2,3");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("checkpoint of another scene")) << r;
    fs::copy(folder_ / "scene", folder_ / "repainted", fs::copy_options::recursive);
    fs::copy(folder_ / "scene/images/0003.png", folder_ / "repainted/images/0001.png",
             fs::copy_options::overwrite_existing);
    r = train("--resume other --iterations 20 --scene repainted");
    EXPECT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("have changed since this checkpoint")) << r;
    EXPECT_EQ(train("--resume nowhere").code, 3);
    EXPECT_EQ(train("--resume").code, 2);
    fs::create_directories(folder_ / "thesis");
    std::ofstream(folder_ / "thesis/config.json") << "{}";
    EXPECT_EQ(train("--config config.json --out thesis --resume").code, 2);
}

TEST_F(ResumeCommand, AFullDiskKeepsTheLastGoodCheckpoint) {
    ASSERT_EQ(train("--config config.json --out full --iterations 12").code, 0);
    const auto bytes = fs::file_size(folder_ / "full/checkpoints/iteration_11.ckpt");
    const auto ply = fs::file_size(folder_ / "full/point_cloud/iteration_12/point_cloud.ply");
    ASSERT_GT(bytes, 2 * ply);
    // Limits files to the space that fits splats but not a checkpoint.
    const std::string limit = "ulimit -f " + std::to_string(2 * ply / 512) + "; ";
    Result r = shell(limit + "OMP_NUM_THREADS=1 " + kTrain +
                     " --device cpu --resume full --iterations 40 --checkpoint-every 10 2>err.txt");
    EXPECT_EQ(r.code, 6) << r;
    EXPECT_TRUE(r.says("Checkpoint not saved: full/checkpoints/iteration_20.ckpt")) << r;
    EXPECT_TRUE(r.says("the run is complete, but --resume cannot extend it")) << r;
    EXPECT_TRUE(fs::exists(folder_ / "full/report.html"));
    EXPECT_EQ(checkpoints("full"), std::vector<std::string>{"iteration_11.ckpt"});
    r = train("--resume full --iterations 120");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(splats("full") == splats("whole"));
}

TEST_F(ResumeCommand, NumericalFailure) {
    ASSERT_EQ(train("--config config.json --out diverging --iterations 12").code, 0);
    // Momentum that makes centres infinite at any learning rate.
    const std::string file = (folder_ / "diverging/checkpoints/iteration_11.ckpt").string();
    State state = read_checkpoint(file);
    for (StateArray& array : state.arrays) {
        const float huge = array.name == "adam.m.means" ? 3e38f : 0.0f;
        if (array.name == "adam.m.means" || array.name == "adam.v.means")
            for (std::size_t at = 0; at < array.bytes.size(); at += 4)
                std::memcpy(array.bytes.data() + at, &huge, 4);
    }
    write_checkpoint(file, {&state});
    const Result r = train("--resume diverging --iterations 60 --report-every 5");
    EXPECT_EQ(r.code, 7) << r;
    EXPECT_TRUE(r.says("the centre of splat ")) << r;
    EXPECT_TRUE(r.says("back to iteration 11, with lr.position_start divided by 10")) << r;
    EXPECT_TRUE(r.says("again after a rollback")) << r;
    EXPECT_TRUE(r.says("the last checkpoint is diverging/checkpoints/iteration_11.ckpt")) << r;
    EXPECT_FALSE(find_not_finite(read_checkpoint(file)));
    int rollbacks = 0;
    for (const json& line : log("diverging")) rollbacks += line.value("event", "") == "rollback";
    EXPECT_EQ(rollbacks, 1);
    EXPECT_TRUE(splats("diverging", 60).empty());
}

TEST_F(ResumeCommand, AMovedFolderIsFollowed) {
    const pid_t child =
        start("--config config.json --iterations 1000000 --report-every 1 --live 1 --out here");
    EXPECT_TRUE(until([&] { return !contents(folder_ / "here/live/state.json").empty(); }));
    fs::rename(folder_ / "here", folder_ / "there");
    const std::string log = contents(folder_ / "there/log.jsonl");
    EXPECT_TRUE(
        until([&] { return contents(folder_ / "there/log.jsonl").size() > log.size() + 2000; }));
    ::kill(child, SIGTERM);
    EXPECT_EQ(wait_for(child), 143);
    EXPECT_FALSE(fs::exists(folder_ / "here"));
    EXPECT_EQ(checkpoints("there").size(), 1u);
}

TEST_F(ResumeCommand, OneProcessPerFolder) {
    const pid_t child =
        start("--config config.json --iterations 1000000 --report-every 1 --out busy");
    EXPECT_TRUE(until([&] { return !contents(folder_ / "busy/log.jsonl").empty(); }));
    for (const char* how : {"--overwrite", "--resume", ""}) {
        const Result r = shell(std::string(kTrain) + " --config config.json --device cpu " + how +
                               " --out busy >out.txt 2>err2.txt");
        EXPECT_EQ(r.code, 2);
        EXPECT_NE(contents(folder_ / "err2.txt").find("another tvsgs-train writes there"),
                  std::string::npos);
    }
    const Result mesh = run_tool(folder_, "extract-mesh", "busy");
    EXPECT_EQ(mesh.code, 3);
    EXPECT_TRUE(mesh.says("it is training; wait for the end")) << mesh;
    ::kill(child, SIGTERM);
    EXPECT_EQ(wait_for(child), 143);
    EXPECT_EQ(checkpoints("busy").size(), 1u);
}

}  // namespace
}  // namespace tvsgs
