// CPU threads of the process: how many, and loops that they share. Threads that wait sleep.
#pragma once

#include <memory>

namespace tvsgs {

/// Threads that a loop may use: set_thread_count(), else OMP_NUM_THREADS, else the CPUs that the
/// process may run on.
int thread_count();

/// `count` >= 1. Call it while no loop runs.
void set_thread_count(int count);

namespace detail {

/// A body and a function that calls it, without the allocation of std::function.
struct ChunkBody {
    const void* body;
    void (*call)(const void* body, int chunk, int slot);
};
void run_chunks(int chunks, const ChunkBody& body);

}  // namespace detail

/// Calls body(chunk, slot) once for each chunk in [0, chunks). Threads take chunks in ascending
/// order; a body may wait for an earlier chunk only if no body throws. `slot`, in
/// [0, thread_count()), is used by one thread at a time: bodies index scratch memory with it. A
/// loop within a body runs on the thread of the body, unless the outer loop has one chunk. After a
/// body has thrown, no further chunk begins, and one of the exceptions is thrown here.
template <class Body>
void run_chunks(int chunks, const Body& body) {
    detail::run_chunks(chunks, {std::addressof(body), [](const void* b, int chunk, int slot) {
                                    (*static_cast<const Body*>(b))(chunk, slot);
                                }});
}

/// Calls body(begin, end, slot) for consecutive ranges of at most `size` indices of [0, count).
template <class Body>
void run_ranges(int count, int size, const Body& body) {
    run_chunks((count + size - 1) / size, [&](int chunk, int slot) {
        const int begin = chunk * size;
        body(begin, count - begin < size ? count : begin + size, slot);
    });
}

}  // namespace tvsgs
