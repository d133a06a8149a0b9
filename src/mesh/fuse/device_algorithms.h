// Sorting, scanning and free memory, for CPU and CUDA.
#pragma once

#include <cstdint>

#include "core/device/buffer.h"

namespace tvsgs {

/// Sorts ascending and drops repetitions; the buffer is resized.
void sort_unique(Buffer<std::uint64_t, Cpu>& keys);
void sort_unique(Buffer<std::uint64_t, Cuda>& keys);

/// Replaces each count by the sum of the counts before it. Returns the total in 64 bits; if it does
/// not fit into 32 bits, the sums are invalid.
std::uint64_t exclusive_scan(Buffer<std::uint32_t, Cpu>& counts);
std::uint64_t exclusive_scan(Buffer<std::uint32_t, Cuda>& counts);

/// Free memory in bytes.
inline std::int64_t free_bytes(Cpu) {
    return free_host_bytes();
}
std::int64_t free_bytes(Cuda);

/// Host memory that a mesher may use: a share of the free memory, at most `max_bytes`.
std::int64_t host_budget(std::int64_t max_bytes);

/// First i in the ascending `keys` with keys[i] >= key.
TVSGS_HD inline int lower_bound(Span<const std::uint64_t> keys, std::uint64_t key) {
    int first = 0, last = keys.size();
    while (first < last) {
        const int middle = first + (last - first) / 2;
        if (keys[middle] < key)
            first = middle + 1;
        else
            last = middle;
    }
    return first;
}

/// Index of `key` in the ascending `keys`; -1: not found.
TVSGS_HD inline int find_key(Span<const std::uint64_t> keys, std::uint64_t key) {
    const int i = lower_bound(keys, key);
    return i < keys.size() && keys[i] == key ? i : -1;
}

}  // namespace tvsgs
