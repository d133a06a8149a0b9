#include "core/device/threads.h"

#include <sched.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace tvsgs {
namespace {

/// How often a thread yields before it sleeps: loops often follow one another within microseconds.
constexpr int kYields = 20;

constexpr int kMostThreads = 1024;  // also the limit of --threads

thread_local bool within_loop = false;

/// One call of run_chunks().
struct Loop {
    Loop(const detail::ChunkBody& b, int n) : body(b), chunks(n) {}

    const detail::ChunkBody& body;
    const int chunks;
    std::atomic<int> next_chunk = 0;
    int next_slot = 1, slots = 1;  // the caller has slot 0; guarded by Pool::mutex_
    std::atomic<int> workers = 0;  // that are in run()
    std::mutex error_mutex;
    std::exception_ptr error;

    bool done() const { return next_chunk.load(std::memory_order_relaxed) >= chunks; }

    void run(int slot) noexcept {
        within_loop = true;
        for (int chunk; (chunk = next_chunk.fetch_add(1, std::memory_order_relaxed)) < chunks;)
            try {
                body.call(body.body, chunk, slot);
            } catch (...) {
                next_chunk.store(chunks, std::memory_order_relaxed);
                const std::lock_guard lock(error_mutex);
                error = std::current_exception();
            }
        within_loop = false;
    }
};

/// Workers that several callers may use at once. They are never joined: they sleep until the
/// process ends.
class Pool {
public:
    static Pool& get() {
        static Pool* const pool = new Pool;  // never destroyed, as the workers use it
        return *pool;
    }

    int count() const { return count_; }
    void set_count(long count) {
        count_ = static_cast<int>(std::clamp(count, 1L, long{kMostThreads}));
    }

    void run(Loop& loop) {
        loop.slots = std::min(count_, loop.chunks);
        {
            const std::lock_guard lock(mutex_);
            for (; threads_ < loop.slots - 1; ++threads_) try {
                    std::thread([this] { work(); }).detach();
                } catch (const std::system_error&) {
                    break;  // the system allows no more threads: the loop runs on fewer
                }
            loops_.push_back(&loop);
            epoch_.fetch_add(1, std::memory_order_relaxed);
            if (loop.slots - 1 >= threads_)
                wake_.notify_all();
            else
                for (int i = 1; i < loop.slots; ++i) wake_.notify_one();
        }
        loop.run(0);
        {
            const std::lock_guard lock(mutex_);
            std::erase(loops_, &loop);  // no worker enters it from here on
        }
        for (int i = 0; i < kYields && loop.workers.load(std::memory_order_acquire) > 0; ++i)
            std::this_thread::yield();
        std::unique_lock lock(mutex_);
        left_.wait(lock, [&] { return loop.workers.load(std::memory_order_acquire) == 0; });
    }

private:
    Pool() {
        const char* const asked = std::getenv("OMP_NUM_THREADS");
        const long number = asked != nullptr ? std::strtol(asked, nullptr, 10) : 0;
        cpu_set_t cpus;
        set_count(number > 0 ? number
                  : sched_getaffinity(0, sizeof cpus, &cpus) == 0
                      ? CPU_COUNT(&cpus)
                      : static_cast<int>(std::thread::hardware_concurrency()));
    }

    /// A loop that a worker can enter, or null. Needs mutex_.
    Loop* open_loop() {
        for (Loop* loop : loops_)
            if (loop->next_slot < loop->slots && !loop->done()) return loop;
        return nullptr;
    }

    [[noreturn]] void work() {
        std::unique_lock lock(mutex_);
        for (;;) {
            Loop* const loop = open_loop();
            if (loop == nullptr) {
                const auto seen = epoch_.load(std::memory_order_relaxed);
                lock.unlock();
                for (int i = 0; i < kYields && epoch_.load(std::memory_order_relaxed) == seen; ++i)
                    std::this_thread::yield();
                lock.lock();
                wake_.wait(lock, [&] { return epoch_.load(std::memory_order_relaxed) != seen; });
                continue;
            }
            const int slot = loop->next_slot++;
            loop->workers.fetch_add(1, std::memory_order_relaxed);
            lock.unlock();
            loop->run(slot);
            lock.lock();
            if (loop->workers.fetch_sub(1, std::memory_order_acq_rel) == 1) left_.notify_all();
        }
    }

    std::mutex mutex_;
    std::condition_variable wake_, left_;
    std::vector<Loop*> loops_;  // that may have chunks left
    int threads_ = 0;
    int count_ = 1;
    std::atomic<std::uint64_t> epoch_ = 0;  // loops so far
};

}  // namespace

int thread_count() {
    return Pool::get().count();
}

void set_thread_count(int count) {
    Pool::get().set_count(count);
}

void detail::run_chunks(int chunks, const ChunkBody& body) {
    if (chunks <= 0) return;
    if (within_loop || chunks == 1 || Pool::get().count() == 1) {
        for (int chunk = 0; chunk < chunks; ++chunk) body.call(body.body, chunk, 0);
        return;
    }
    Loop loop(body, chunks);
    Pool::get().run(loop);
    if (loop.error) std::rethrow_exception(loop.error);
}

}  // namespace tvsgs
