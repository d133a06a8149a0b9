// Ranks of a training as threads of the test.
#pragma once

#include <barrier>
#include <cstring>
#include <thread>
#include <vector>

#include "comm/communicator.h"

namespace tvsgs::test {

/// What the threads share.
struct ThreadGroup {
    explicit ThreadGroup(int size) : parts(static_cast<std::size_t>(size)), meet(size) {}
    std::vector<const void*> parts;
    std::barrier<> meet;
};

class ThreadRank final : public Communicator {
public:
    ThreadRank(ThreadGroup& group, int rank) : group_(group), rank_(rank) {}
    int rank() const override { return rank_; }
    int size() const override { return static_cast<int>(group_.parts.size()); }
    void gather(const void* part, std::size_t bytes, void* all) override {
        group_.parts[static_cast<std::size_t>(rank_)] = part;
        group_.meet.arrive_and_wait();
        for (std::size_t r = 0; r < group_.parts.size(); ++r)
            if (bytes > 0) std::memcpy(static_cast<char*>(all) + r * bytes, group_.parts[r], bytes);
        group_.meet.arrive_and_wait();
    }

private:
    ThreadGroup& group_;
    int rank_;
};

/// run(communicator) on `size` threads.
template <class Run>
void on_ranks(int size, const Run& run) {
    ThreadGroup group(size);
    std::vector<std::thread> threads;
    for (int rank = 0; rank < size; ++rank)
        threads.emplace_back([&, rank] {
            ThreadRank communicator(group, rank);
            run(communicator);
        });
    for (std::thread& thread : threads) thread.join();
}

}  // namespace tvsgs::test
