// Scheduling of block processes, with shell scripts in place of tvsgs-train.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "core/device/device_choice.h"
#include "core/error.h"
#include "core/log.h"
#include "pipeline/blocks/blocks_schedule.h"
#include "pipeline/run/signals.h"
#include "support/command.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// An event of a block: "start" or "end", and its place.
struct Event {
    std::string what, place;
    int block = 0;
    bool alone = false;
};

class BlockSchedules : public testing::Test {
protected:
    void SetUp() override {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_schedule_" + std::to_string(getpid()));
        fs::remove_all(folder_);
        fs::create_directories(folder_);
        schedule_.places = {"a", "b"};
        schedule_.command = [](int block, const std::string& place, bool alone) {
            return ChildProcess::Command{{"/bin/sh", folder_ / "train.sh", std::to_string(block),
                                          place, alone ? "alone" : "beside"},
                                         {"OMP_NUM_THREADS=3"},
                                         true};
        };
        init_log(Verbosity::normal);
        testing::internal::CaptureStderr();
    }
    void TearDown() override {
        messages();  // ends the capture
        fs::remove_all(folder_);
    }

    /// Writes the program: `body` is a shell script that gets the block in $1 and the place in $2.
    static void write_program(const std::string& body) {
        std::ofstream(folder_ / "train.sh")
            << "cd '" << folder_.string() << "'\necho start $1 $2 $3 >>events\n"
            << body << "\necho end $1 $2 $3 >>events\n";
    }
    std::vector<BlockFailure> run(int blocks) {
        std::vector<BlockJob> jobs;
        for (int block = 1; block <= blocks; ++block)
            jobs.push_back({block, log(block).string(), 100});
        return run_blocks(jobs, schedule_);
    }
    static fs::path log(int block) { return folder_ / (std::to_string(block) + ".log"); }
    static std::vector<Event> events() {
        std::istringstream lines(contents(folder_ / "events"));
        std::vector<Event> events;
        std::string alone;
        for (Event e; lines >> e.what >> e.block >> e.place >> alone;) {
            e.alone = alone == "alone";
            events.push_back(e);
        }
        return events;
    }
    const std::string& messages() {
        if (messages_.empty()) messages_ = testing::internal::GetCapturedStderr() + "\n";
        return messages_;
    }

    static inline fs::path folder_;
    BlockSchedule schedule_;
    std::string messages_;
};

TEST_F(BlockSchedules, APlaceTakesTheNextBlockWhenItIsFree) {
    // The first block ends after all others.
    write_program("[ $1 = 1 ] && until grep -q 'end 5' events; do sleep 0.02; done");
    EXPECT_TRUE(run(5).empty());
    std::map<std::string, int> on;  // number of blocks per place
    std::map<std::string, std::set<int>> all;
    std::size_t most = 0;
    for (const Event& e : events()) {
        EXPECT_FALSE(e.alone);
        if (e.what == "start") {
            EXPECT_EQ(on.count(e.place), 0u) << "two on " << e.place;
            on[e.place] = e.block;
            all[e.place].insert(e.block);
        } else {
            on.erase(e.place);
        }
        most = std::max(most, on.size());
    }
    EXPECT_EQ(most, 2u);
    EXPECT_EQ(all["a"], std::set<int>{1});
    EXPECT_EQ(all["b"], (std::set<int>{2, 3, 4, 5}));
    EXPECT_NE(messages().find("is done, 5 of 5"), std::string::npos) << messages();
}

TEST_F(BlockSchedules, AFailedBlockRunsAgainAloneAfterTheOthers) {
    write_program(R"(if [ $1 = 2 ] && ! [ -e failed ]; then
        touch failed; echo before; echo error: no luck; echo '  while training'; exit 4
    fi)");
    EXPECT_TRUE(run(4).empty());
    const std::vector<Event> seen = events();
    ASSERT_EQ(seen.size(), 9u);  // one start has no end
    EXPECT_EQ(seen[7].block, 2);
    EXPECT_TRUE(seen[7].alone && seen[8].alone);
    const auto first =
        std::find_if(seen.begin(), seen.end(), [](const Event& e) { return e.block == 2; });
    EXPECT_NE(first->place, seen[7].place) << "another place than the one where it failed";
    for (const char* part : {"Block 2 failed on", "exit code 4: error: no luck\n  while training",
                             "It runs once more, alone", "Block 2 is done, 4 of 4"})
        EXPECT_NE(messages().find(part), std::string::npos) << messages() << "\nlacks " << part;
    EXPECT_EQ(messages().find("before"), std::string::npos) << messages();
    EXPECT_NE(contents(log(2)).find("before\nerror: no luck\n"), std::string::npos);
}

TEST_F(BlockSchedules, BlocksThatFailTwiceAreReturnedWithTheirCodes) {
    write_program("[ $1 = 2 ] && kill -9 $$; [ $1 = 3 ] && exit 3; true");
    const std::vector<BlockFailure> failures = run(4);
    ASSERT_EQ(failures.size(), 2u);
    std::map<int, int> codes;
    for (const BlockFailure& failure : failures) codes[failure.block] = failure.code;
    EXPECT_EQ(codes, (std::map<int, int>{{2, 137}, {3, 3}}));
    EXPECT_EQ(events().size(), 8u);  // two starts with an end, two blocks started twice
    EXPECT_NE(messages().find("Block 2 failed again on"), std::string::npos) << messages();
    EXPECT_NE(messages().find("ended by signal 9 (Killed)"), std::string::npos) << messages();
}

TEST_F(BlockSchedules, APlaceWithoutAUsableDeviceGetsNoFurtherBlock) {
    write_program("[ $2 = b ] && exit 5; true");
    EXPECT_TRUE(run(5).empty());
    const std::vector<Event> seen = events();
    EXPECT_EQ(
        std::count_if(seen.begin(), seen.end(), [](const Event& e) { return e.place == "b"; }), 1);
    EXPECT_NE(messages().find("b is no longer used"), std::string::npos) << messages();
}

TEST_F(BlockSchedules, WithoutAnyUsableDeviceAllBlocksFail) {
    write_program("exit 5");
    const std::vector<BlockFailure> failures = run(3);
    ASSERT_EQ(failures.size(), 3u);
    for (const BlockFailure& failure : failures) EXPECT_EQ(failure.code, 5);
}

TEST_F(BlockSchedules, ASignalIsSentOnAndAllProcessesEndFirst) {
    // The second block stops the scheduler when the first block is ready.
    write_program(R"(trap 'sleep 0.1; echo saved $1 x x >>events; exit 130' INT
    [ $1 = 1 ] && touch ready
    [ $1 = 2 ] && until [ -e ready ]; do sleep 0.02; done
    [ $1 = 2 ] && kill -INT $PPID
    while :; do sleep 0.02; done)");
    try {
        run(3);
        ADD_FAILURE() << "not stopped";
    } catch (const Stopped& stopped) {
        EXPECT_EQ(stopped.signal, SIGINT);
    }
    std::multiset<std::string> seen;
    for (const Event& e : events()) seen.insert(e.what + std::to_string(e.block));
    EXPECT_EQ(seen, (std::multiset<std::string>{"saved1", "saved2", "start1", "start2"}));
    EXPECT_NE(messages().find("0 of 3 blocks are done"), std::string::npos) << messages();
    EXPECT_EQ(messages().find("failed"), std::string::npos) << messages();
}

TEST_F(BlockSchedules, ProgressIsShownAndOtherLinesAreLogged) {
    // The block continues when its progress has been shown.
    write_program(R"(echo threads: $OMP_NUM_THREADS >&2
    echo '{"iteration": 50, "seconds": 1}' >&2
    until [ -e shown ]; do sleep 0.02; done
    printf 'no end')");
    int reports = 0;
    schedule_.on_report = [&](int block, const JsonValue& report) {
        EXPECT_EQ(block, 1);
        EXPECT_EQ(report["iteration"].number_or(0), 50);
        ++reports;
    };
    schedule_.show = [&](const std::vector<BlockProgress>& running, int, int waiting) {
        EXPECT_EQ(waiting, 0);
        if (running.empty() || running[0].share == 0) return;
        EXPECT_EQ(running[0].share, 0.5);
        EXPECT_EQ(running[0].place, "a");
        std::ofstream(folder_ / "shown") << "";
    };
    EXPECT_TRUE(run(1).empty());
    EXPECT_EQ(reports, 1);
    const std::string said = contents(log(1));
    EXPECT_NE(said.find("\nthreads: 3\nno end\n"), std::string::npos) << said;
    EXPECT_EQ(said.find("iteration"), std::string::npos) << said;
}

TEST_F(BlockSchedules, ABlockThatCannotStartFailsAndTheOthersGoOn) {
    write_program("true");
    const auto command = schedule_.command;
    schedule_.command = [&](int block, const std::string& place, bool alone) {
        if (block == 2) throw Error(ExitCode::input, "its folder is gone");
        return command(block, place, alone);
    };
    const std::vector<BlockFailure> failures = run_blocks(
        {{1, folder_ / "none/1.log", 100}, {2, log(2), 100}, {3, log(3), 100}}, schedule_);
    ASSERT_EQ(failures.size(), 2u);
    EXPECT_EQ(failures[0].code, static_cast<int>(ExitCode::io));
    EXPECT_EQ(failures[1].code, static_cast<int>(ExitCode::input));
    EXPECT_EQ(events().size(), 2u);
    EXPECT_NE(messages().find("none/1.log: cannot write it"), std::string::npos) << messages();
    EXPECT_NE(messages().find("its folder is gone"), std::string::npos) << messages();
}

ExitCode refusal(const std::string& list, int count) {
    try {
        choose_gpus(list, count);
    } catch (const Error& error) {
        EXPECT_NE(std::string(error.what()).find("--gpus " + list), std::string::npos);
        return error.code();
    }
    return ExitCode::done;
}

TEST(GpuLists, NameEachGpuOnceAndNoneThatIsNotThere) {
    EXPECT_EQ(choose_gpus("all", 3), (std::vector<int>{0, 1, 2}));
    EXPECT_EQ(choose_gpus("2,0", 3), (std::vector<int>{2, 0}));
    for (const char* bad : {"", "0,", ",1", "one", "-1", "0-1", "0, 1", "0,1,0", "1,1", "1e0"})
        EXPECT_EQ(refusal(bad, 3), ExitCode::usage) << bad;
    for (const char* absent : {"3", "0,3", "999"})
        EXPECT_EQ(refusal(absent, 3), ExitCode::device) << absent;
    EXPECT_EQ(refusal("all", 0), ExitCode::device);
}

}  // namespace
}  // namespace tvsgs
