// Loops that threads share: every chunk once, slots of one thread at a time, exceptions, nesting.
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/resource.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "core/device/parallel.h"

namespace tvsgs {
namespace {

int available_cpus() {
    cpu_set_t cpus;
    return sched_getaffinity(0, sizeof cpus, &cpus) == 0 ? CPU_COUNT(&cpus) : 0;
}

class Threads : public ::testing::TestWithParam<int> {
protected:
    void SetUp() override { set_thread_count(GetParam()); }
    void TearDown() override { set_thread_count(before_); }

private:
    const int before_ = thread_count();
};

TEST_P(Threads, RunEveryChunkOnce) {
    for (const int chunks : {0, 1, 2, 3, 1000}) {
        std::vector<std::atomic<int>> runs(static_cast<std::size_t>(chunks));
        run_chunks(chunks, [&](int chunk, int) { ++runs[static_cast<std::size_t>(chunk)]; });
        for (const auto& count : runs) EXPECT_EQ(count, 1) << chunks << " chunks";
    }
}

TEST_P(Threads, GiveASlotToOneThreadAtATime) {
    std::vector<std::atomic<int>> users(static_cast<std::size_t>(GetParam()));
    std::atomic<int> shared = 0, outside = 0;
    run_chunks(500, [&](int, int slot) {
        if (slot < 0 || slot >= GetParam()) {
            ++outside;
            return;
        }
        auto& user = users[static_cast<std::size_t>(slot)];
        if (++user != 1) ++shared;
        std::this_thread::sleep_for(std::chrono::microseconds(20));
        --user;
    });
    EXPECT_EQ(shared, 0);
    EXPECT_EQ(outside, 0);
}

// Bodies may wait for an earlier chunk: threads take chunks in ascending order.
TEST_P(Threads, LetAChunkWaitForTheOneBeforeIt) {
    std::atomic<int> turn = 0;
    std::vector<int> order;
    run_chunks(200, [&](int chunk, int) {
        for (int now; (now = turn.load()) != chunk;) turn.wait(now);
        order.push_back(chunk);
        turn = chunk + 1;
        turn.notify_all();
    });
    ASSERT_EQ(order.size(), 200u);
    for (int i = 0; i < 200; ++i) EXPECT_EQ(order[static_cast<std::size_t>(i)], i);
}

TEST_P(Threads, ThrowWhatABodyThrows) {
    std::atomic<int> runs = 0;
    const auto loop = [&] {
        std::atomic<bool> thrown = false;
        run_chunks(1000, [&](int chunk, int) {
            ++runs;
            if (chunk == 7) {
                thrown = true;
                throw std::runtime_error("chunk 7");
            }
            // Later chunks are slow, so that the exception is caught before the last one begins.
            while (chunk > 7 && !thrown) std::this_thread::yield();
            if (chunk > 7) std::this_thread::sleep_for(std::chrono::milliseconds(2));
        });
    };
    EXPECT_THROW(loop(), std::runtime_error);
    EXPECT_LT(runs, 1000) << "chunks began after the exception";
    EXPECT_THROW(loop(), std::runtime_error) << "the threads are usable again";
}

TEST_P(Threads, RunALoopWithinABodyOnItsThread) {
    std::atomic<int> elsewhere = 0, total = 0;
    run_chunks(50, [&](int, int) {
        const auto here = std::this_thread::get_id();
        run_chunks(20, [&](int, int) {
            ++total;
            if (std::this_thread::get_id() != here) ++elsewhere;
        });
    });
    EXPECT_EQ(total, 1000);
    EXPECT_EQ(elsewhere, 0);
}

TEST_P(Threads, ServeSeveralCallersAtOnce) {
    std::vector<std::int64_t> sums(4);
    std::vector<std::thread> callers;
    for (std::size_t caller = 0; caller < sums.size(); ++caller)
        callers.emplace_back([&, caller] {
            for (int round = 0; round < 50; ++round)
                run_chunks(40, [&](int chunk, int) { add_atomically(&sums[caller], chunk); });
        });
    for (std::thread& caller : callers) caller.join();
    for (const std::int64_t sum : sums) EXPECT_EQ(sum, 50 * 780);
}

TEST_P(Threads, SumToTheSameBits) {
    const auto sum = [] {
        std::vector<double> partial(kSumBlocks);
        double total = 0;
        add_sum(
            Cpu{}, 100000, [](int i) { return 1.0 / (i + 1); }, 1.0,
            Span<double>{partial.data(), partial.size()}, &total);
        return total;
    };
    const double here = sum();
    set_thread_count(1);
    EXPECT_EQ(here, sum());
}

// Threads that spin take CPU time; on a busy machine, threads that yield switch often instead.
TEST_P(Threads, SleepBetweenLoops) {
    run_chunks(100, [](int, int) {});
    rusage before{}, after{};
    getrusage(RUSAGE_SELF, &before);
    const std::clock_t begin = std::clock();
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    EXPECT_LT(std::clock() - begin, CLOCKS_PER_SEC / 50);
    getrusage(RUSAGE_SELF, &after);
    EXPECT_LT(after.ru_nivcsw - before.ru_nivcsw, 300) << "20 yields of seven threads at most";
}

INSTANTIATE_TEST_SUITE_P(Counts, Threads, ::testing::Values(1, 2, 3, 8));

// In a new process each, because a process reads the variable once.
TEST(ThreadCountDeathTest, HasALimit) {
    GTEST_FLAG_SET(death_test_style, "threadsafe");
    const auto count_with = [](const char* variable) {
        setenv("OMP_NUM_THREADS", variable, 1);
        std::fprintf(stderr, "%d threads", thread_count());
        std::_Exit(0);
    };
    EXPECT_EXIT(count_with("3"), testing::ExitedWithCode(0), "^3 threads");
    EXPECT_EXIT(count_with("100000"), testing::ExitedWithCode(0), "^1024 threads");
    EXPECT_EXIT(count_with("99999999999999999999"), testing::ExitedWithCode(0), "^1024 threads");
    const std::string all = "^" + std::to_string(available_cpus()) + " threads";
    EXPECT_EXIT(count_with("abc"), testing::ExitedWithCode(0), all);
    EXPECT_EXIT(count_with("-5"), testing::ExitedWithCode(0), all);
}

}  // namespace
}  // namespace tvsgs
