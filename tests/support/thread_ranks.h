// Ranks of a training as threads of the test.
#pragma once

#include <omp.h>

#include <barrier>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <thread>
#include <vector>

#include "comm/communicator.h"
#include "comm/state_parts.h"

namespace tvsgs::test {

/// What the threads share.
struct ThreadGroup {
    explicit ThreadGroup(int size)
        : parts(static_cast<std::size_t>(size)), places(parts.size()), meet(size) {}
    std::vector<const void*> parts;
    std::vector<const std::vector<std::size_t>*> places;
    std::barrier<> meet;
};

class ThreadRank final : public Communicator {
public:
    ThreadRank(ThreadGroup& group, int rank) : group_(group), rank_(rank) {}
    int rank() const override { return rank_; }
    int size() const override { return static_cast<int>(group_.parts.size()); }
    int local_rank() const override { return rank_; }
    int local_size() const override { return size(); }
    [[noreturn]] void abort(int code) override { std::_Exit(code); }
    void leave() override { wait_for_all("end"); }

    std::size_t gathered = 0, dealt = 0;  // bytes of all; bytes of those meant for this rank
    int gathers = 0;

private:
    void gather(const void* part, const Begins& begins, void* all, bool) override {
        group_.parts[static_cast<std::size_t>(rank_)] = part;
        group_.meet.arrive_and_wait();
        for (std::size_t r = 0; r < group_.parts.size(); ++r)
            if (char* const to = static_cast<char*>(all) + begins[r];
                begins[r + 1] > begins[r] && to != group_.parts[r])
                std::memcpy(to, group_.parts[r], begins[r + 1] - begins[r]);
        gathered += begins.back(), ++gathers;
        group_.meet.arrive_and_wait();
    }

    void deal(const void* parts, const Begins& to, void* got, const Begins& from) override {
        const auto own = static_cast<std::size_t>(rank_);
        group_.parts[own] = parts, group_.places[own] = &to;
        group_.meet.arrive_and_wait();
        for (std::size_t r = 0; r < group_.parts.size(); ++r) {
            const std::vector<std::size_t>& sent = *group_.places[r];
            const std::size_t bytes = from[r + 1] - from[r];
            if (bytes != sent[own + 1] - sent[own]) {  // no backend would come back from that
                std::fprintf(stderr, "rank %zu sends %zu bytes, rank %d expects %zu\n", r,
                             sent[own + 1] - sent[own], rank_, bytes);
                std::abort();
            }
            if (bytes > 0)
                std::memcpy(static_cast<char*>(got) + from[r],
                            static_cast<const char*>(group_.parts[r]) + sent[own], bytes);
        }
        dealt += from.back();
        group_.meet.arrive_and_wait();
    }

    ThreadGroup& group_;
    int rank_;
};

/// run(communicator) on `size` threads; by itself, with null, where that is 1.
template <class Run>
void on_ranks(int size, const Run& run) {
    if (size == 1) return run(static_cast<ThreadRank*>(nullptr));
    ThreadGroup group(size);
    std::vector<std::thread> threads;
    for (int rank = 0; rank < size; ++rank)
        threads.emplace_back([&, rank] {
            omp_set_num_threads(1);  // more would wait for each other
            ThreadRank communicator(group, rank);
            run(&communicator);
        });
    for (std::thread& thread : threads) thread.join();
}

/// The whole on rank 0; the others get no arrays.
inline State whole_state(Communicator* peers, const State& part) {
    State whole;
    if (rank_of(peers) == 0) whole = room_for_whole(part);
    gather_state(peers, part, rank_of(peers) == 0 ? &whole : nullptr);
    return whole;
}

}  // namespace tvsgs::test
