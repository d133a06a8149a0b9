// tvsgs-train as several processes: the bits of one, and how it ends when something is wrong.
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>

#include "io/checkpoint.h"
#include "support/command.h"
#include "support/mpirun.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

constexpr const char* kTrain = TVSGS_BIN_DIR "/train_ranks --device cpu ";

class RanksCommand : public testing::Test {
protected:
    void SetUp() override { TVSGS_SKIP_WITHOUT_MPI(); }

    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_ranks_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        if (test::mpirun(1).empty()) return;
        ASSERT_EQ(
            run_tool(folder_, "synth",
                     "--out scene --views 10 --arc 180 --width 48 --height 36 --exposure-drift 0.2")
                .code,
            0);
        // Everything that steps can meet: growth, trims, resets, votes, other views, exposures.
        std::ofstream(folder_ / "config.json") << R"({
            "scene": {"path": "scene"}, "comm": {"batch": 4}, "iterations": 203,
            "backbone": "pgsr", "init": {"min_points": 0},
            "loss": {"photometric": {"exposure": "true", "exposure_start": 10},
                     "flatten": {"weight": 1}, "tv_normal": {"weight": 0.05},
                     "tv_position": {"weight": 0.05},
                     "multi_view": {"limits": "relative", "max_angle_deg": 60},
                     "multi_view_geometry": {"weight": 0.03, "start": 20},
                     "multi_view_ncc": {"weight": 0.15, "start": 30}},
            "tv": {"k": 20, "refresh_every": 25},
            "densify": {"from": 20, "every": 15, "trim_every": 50, "opacity_reset_every": 90,
                        "max_gaussians": 4500}})";
        const Result whole = train(1, "--config config.json --out whole --checkpoint-every 100");
        ASSERT_EQ(whole.code, 0) << whole;
        ASSERT_GT(splats("whole").size(), 100000u);
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static std::string line(int ranks, const std::string& arguments) {
        return "env OMP_NUM_THREADS=1 " + (ranks > 1 ? test::mpirun(ranks) : "") + kTrain +
               arguments;
    }
    static Result train(int ranks, const std::string& arguments) {
        return run_script(folder_, "timeout 120 " + line(ranks, arguments) + " >out.txt 2>err.txt");
    }

    /// In the background, in a process group of its own, its messages in err.txt.
    static pid_t start(int ranks, const std::string& arguments) {
        const pid_t child = ::fork();
        if (child != 0) return child;
        const std::string all = "exec " + line(ranks, arguments) + " >out.txt 2>err.txt";
        if (::chdir(folder_.c_str()) == 0)
            ::execl("/bin/sh", "sh", "-c", all.c_str(), static_cast<char*>(nullptr));
        ::_exit(127);
    }
    static Result wait_for(pid_t child) {
        int status = 0;
        ::waitpid(child, &status, 0);
        return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status),
                contents(folder_ / "out.txt"), contents(folder_ / "err.txt")};
    }

    /// The process of each rank of a run: launchers say its rank in the environment.
    static std::vector<pid_t> ranks_of(const std::string& run, int ranks) {
        std::vector<pid_t> found(static_cast<std::size_t>(ranks), 0);
        std::error_code code;
        for (const auto& entry : fs::directory_iterator("/proc", code)) {
            const pid_t pid = std::atoi(entry.path().filename().c_str());
            if (pid <= 0 || fs::read_symlink(entry.path() / "cwd", code) != folder_) continue;
            if (fs::read_symlink(entry.path() / "exe", code).filename() != "train_ranks") continue;
            const std::string command = contents(entry.path() / "cmdline"),
                              environment = contents(entry.path() / "environ");
            if (command.find(run) == std::string::npos) continue;
            for (const std::string name : {"OMPI_COMM_WORLD_RANK=", "PMI_RANK="})
                if (const auto at = environment.find('\0' + name); at != std::string::npos) {
                    const int rank = std::atoi(environment.c_str() + at + 1 + name.size());
                    if (rank >= 0 && rank < ranks) found[static_cast<std::size_t>(rank)] = pid;
                }
        }
        return found;
    }

    /// Once `bytes` of the log are written; false: they never were.
    static bool until_log(const std::string& run, std::size_t bytes) {
        for (int i = 0; i < 2400; ++i) {
            if (contents(folder_ / run / "log.jsonl").size() > bytes) return true;
            ::usleep(25000);
        }
        return false;
    }

    static std::string splats(const std::string& run, int iteration = 203) {
        return contents(folder_ / run / "point_cloud" / ("iteration_" + std::to_string(iteration)) /
                        "point_cloud.ply");
    }

    /// The arrays of a checkpoint are those of the uninterrupted run of one process.
    static void expect_same_checkpoint(const std::string& run, int iteration) {
        const std::string file = "checkpoints/iteration_" + std::to_string(iteration) + ".ckpt";
        const State one = read_checkpoint((folder_ / "whole" / file).string()),
                    other = read_checkpoint((folder_ / run / file).string());
        ASSERT_EQ(one.arrays.size(), other.arrays.size());
        for (const StateArray& array : one.arrays) {
            if (array.name == "run.config" || array.name == "run.seconds") continue;
            const StateArray* const same = other.find(array.name);
            ASSERT_NE(same, nullptr) << array.name;
            ASSERT_EQ(same->bytes.size(), array.bytes.size()) << array.name;
            EXPECT_EQ(std::memcmp(same->bytes.data(), array.bytes.data(), array.bytes.size()), 0)
                << array.name;
        }
    }

    static inline fs::path folder_;
};

TEST_F(RanksCommand, HaveTheBitsOfOneProcess) {
    for (const int ranks : {2, 4}) {
        const std::string run = "on_" + std::to_string(ranks);
        // Who looks on changes nothing.
        const std::string looks = ranks == 2 ? " --live 1 --set eval.every=50" : "";
        const Result r =
            train(ranks, "--config config.json --checkpoint-every 100 --out " + run + looks);
        ASSERT_EQ(r.code, 0) << r;
        EXPECT_EQ(contents(folder_ / run / "log.jsonl").find("\"evaluation\"") != std::string::npos,
                  ranks == 2);
        EXPECT_TRUE(splats(run) == splats("whole")) << ranks << " ranks";
        EXPECT_FALSE(r.says("multi-view losses: off")) << "they are part of the test";
        expect_same_checkpoint(run, 100);
        expect_same_checkpoint(run, 200);
        std::size_t said = 0;
        for (std::size_t at = 0; (at = r.err.find("photographs a step", at)) != r.err.npos; ++at)
            ++said;
        EXPECT_EQ(said, 1u) << "one process talks: " << r;
    }
}

TEST_F(RanksCommand, ThePlanSaysWhatEachWillTake) {
    std::int64_t of_fewer = std::numeric_limits<std::int64_t>::max();
    for (const int ranks : {1, 2}) {
        const std::string run = "planned_" + std::to_string(ranks);
        ASSERT_EQ(train(ranks, "--config config.json --iterations 4 --out " + run).code, 0);
        const nlohmann::json memory =
            nlohmann::json::parse(contents(folder_ / run / "memory.json"))["device"];
        const auto bytes = memory["bytes_per_splat"].get<std::int64_t>();
        const Result r = train(ranks, "--config config.json --plan");
        ASSERT_EQ(r.code, 0) << r;
        EXPECT_NE(r.out.find(std::to_string(bytes) + " bytes for each more"), r.out.npos)
            << r.out << memory;
        EXPECT_LT(bytes, of_fewer);
        of_fewer = bytes;
    }
}

TEST_F(RanksCommand, ACheckpointGoesOnWithAnyNumber) {
    ASSERT_EQ(train(4, "--config config.json --out back --iterations 101").code, 0);
    for (const auto& [ranks, iterations] : {std::pair{1, 150}, {3, 203}}) {
        const Result r = train(ranks, "--resume back --iterations " + std::to_string(iterations));
        ASSERT_EQ(r.code, 0) << r;
    }
    EXPECT_TRUE(splats("back") == splats("whole"));
    const Result r = train(2, "--resume back --iterations 400 --set comm.batch=2");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("comm.batch = 2; expected 4")) << r;
}

TEST_F(RanksCommand, AKilledOneEndsTheRunWhichGoesOn) {
    std::mt19937 random(5);
    for (const int victim : {0, 2}) {
        const std::string run = "killed_" + std::to_string(victim);
        const pid_t job =
            start(3, "--config config.json --report-every 1 --checkpoint-every 20 --out " + run);
        ASSERT_TRUE(until_log(run, 3000 + random() % 12000)) << contents(folder_ / "err.txt");
        const auto begin = std::chrono::steady_clock::now();
        const pid_t process = ranks_of(run, 3)[static_cast<std::size_t>(victim)];
        ASSERT_GT(process, 0);
        ::kill(process, SIGKILL);
        const Result r = wait_for(job);
        EXPECT_NE(r.code, 0);
        EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
        for (int i = 0; i < 200 && ranks_of(run, 3) != std::vector<pid_t>(3, 0); ++i)
            ::usleep(50000);
        EXPECT_EQ(ranks_of(run, 3), std::vector<pid_t>(3, 0)) << "all have ended";
        const Result resumed = train(2, "--resume " + run);
        ASSERT_EQ(resumed.code, 0) << resumed;
        EXPECT_TRUE(splats(run) == splats("whole")) << "rank " << victim << " was killed";
    }
}

TEST_F(RanksCommand, ASignalToOneStopsAll) {
    for (const std::size_t receiver : {0, 1}) {
        const std::string run = "stopped_" + std::to_string(receiver);
        const pid_t job = start(2, "--config config.json --report-every 1 --out " + run);
        ASSERT_TRUE(until_log(run, 4000)) << contents(folder_ / "err.txt");
        ::kill(ranks_of(run, 2)[receiver], SIGTERM);
        const Result r = wait_for(job);
        EXPECT_EQ(r.code, 143) << r;
        EXPECT_TRUE(r.says("goes on")) << r;
        const auto files = fs::directory_iterator(folder_ / run / "checkpoints");
        EXPECT_EQ(std::distance(begin(files), end(files)), 1);
        const Result resumed = train(1, "--resume " + run);
        ASSERT_EQ(resumed.code, 0) << resumed;
        EXPECT_TRUE(splats(run) == splats("whole"));
    }
}

TEST_F(RanksCommand, AStuckOneIsNamed) {
    const pid_t job =
        start(2, "--config config.json --report-every 1 --set comm.timeout=2 --out stuck");
    ASSERT_TRUE(until_log("stuck", 4000)) << contents(folder_ / "err.txt");
    ::kill(ranks_of("stuck", 2)[1], SIGSTOP);
    const Result r = wait_for(job);
    EXPECT_EQ(r.code, 9) << r;
    EXPECT_TRUE(r.says("error: rank 0 of 2 has waited 2 s for the others (comm.timeout)")) << r;
}

TEST_F(RanksCommand, RefusesWhatDoesNotFit) {
    struct Case {
        int ranks, code;
        std::string arguments, says;
    };
    for (const Case& c : {
             Case{3, 2, "--set comm.batch=2", "3 processes share the photographs of a step"},
             Case{2, 2, "--set comm.batch=16", "comm.batch = 16"},
             Case{2, 2, "--device cuda:0", "--device cuda:0"},
             Case{2, 2, "--no-such-flag", "--no-such-flag"},
             Case{2, 4, "--set memory.host=1K", "memory"},
         }) {
        const Result r = train(c.ranks, "--config config.json --out refused " + c.arguments);
        EXPECT_EQ(r.code, c.code) << c.arguments << ": " << r;
        EXPECT_TRUE(r.says(c.says)) << r;
        std::size_t errors = 0;
        for (std::size_t at = 0; (at = r.err.find("error: ", at)) != r.err.npos; ++at) ++errors;
        EXPECT_EQ(errors, 1u) << "one clear message: " << r;
        EXPECT_FALSE(fs::exists(folder_ / "refused"));
    }
    // Another environment on one of them.
    std::ofstream(folder_ / "odd.sh") << "[ \"${OMPI_COMM_WORLD_RANK:-$PMI_RANK}\" = 1 ] && "
                                         "export TVSGS_LR__SCALE=0.01\nexec "
                                      << kTrain << " \"$@\"\n";
    const Result r = run_script(folder_, "timeout 60 env " + test::mpirun(2) +
                                             "sh odd.sh --config config.json --out refused "
                                             ">out.txt 2>err.txt");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("the configuration of rank 1: lr.scale is '0.01', and rank 0 has '0.005'"))
        << r;
}

}  // namespace
}  // namespace tvsgs
