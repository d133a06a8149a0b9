// GPU versions of the warps, loops and sorts of warp.h. For .cu files only.
#pragma once

#include <thrust/iterator/counting_iterator.h>
#include <thrust/iterator/transform_iterator.h>

#include <bit>
#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_scan.cuh>

#include "core/device/cuda_runtime.h"
#include "core/device/parallel.h"
#include "core/device/warp_reduce_cuda.h"
#include "tv/internal/warp.h"

namespace tvsgs {

#if defined(__CUDA_ARCH__)
/// One warp. All lanes must take part in every call.
struct CudaWarp {
    static constexpr int kLanes = 32;
    static constexpr unsigned kAll = 0xffffffffu;
    template <class Real>
    using Lane = Real;

    TVSGS_HD static int median_scratch(int /*count*/) { return 0; }

    TVSGS_HD int lane() const { return int(threadIdx.x % 32); }
    TVSGS_HD void sync() const { __syncwarp(); }
    TVSGS_HD static int lowest_bit(std::uint32_t mask) { return __ffs(int(mask)) - 1; }
    template <class T>
    TVSGS_HD T sum(T x) const {  // the same tree, hence the same bits, in all lanes
        for (int offset = 16; offset > 0; offset /= 2) x += __shfl_xor_sync(kAll, x, offset);
        return x;
    }
    template <class T>
    TVSGS_HD T from_lane(T x, int source) const {
        return __shfl_sync(kAll, x, source);
    }
    TVSGS_HD int sum_before(int x) const {
        int sum = x;
        for (int offset = 1; offset < 32; offset *= 2) {
            const int other = __shfl_up_sync(kAll, sum, offset);
            sum += lane() >= offset ? other : 0;
        }
        return sum - x;
    }
    template <class Action>
    TVSGS_HD void for_lanes(const Action& action) const {
        action(lane());
        __syncwarp();
    }
    template <class Value>
    TVSGS_HD std::uint32_t smallest32(const Value& value) const {
        return warp_min(value(lane()));
    }
    TVSGS_HD void sort(std::uint32_t* keys, int count) const { bitonic_sort(*this, keys, count); }
    template <class Predicate>
    TVSGS_HD std::uint32_t ballot32(const Predicate& predicate) const {
        return __ballot_sync(kAll, predicate(lane()));
    }
    template <class Key, class Accept>
    TVSGS_HD int append32(std::uint64_t* out, const Key& key, const Accept& accept) const {
        const std::uint64_t mine = key(lane());
        const bool accepted = accept(mine);
        return append(out, mine, accepted);
    }
    /// Sums over each half of the warp: lane i of a half gets the sums of values 2i and 2i + 1.
    template <class T>
    TVSGS_HD static void sums_to_half_lanes(T (&values)[32], T (&mine)[2]) {
        halve<8>(values);
        mine[0] = values[0], mine[1] = values[1];
    }
    TVSGS_HD std::uint64_t smallest_first(std::uint64_t* keys, int count, int wanted) const {
        sync();
        if (count > 512) {
            bitonic_sort(*this, keys, count);
            return keys[wanted - 1];
        }
        return count <= 256 ? select<8>(keys, count, wanted) : select<16>(keys, count, wanted);
    }

    template <class Value>
    TVSGS_HD float median(int count, float*, const Value& value) const {
        return count <= 128 ? median_of<4>(count, value) : median_of<16>(count, value);
    }

private:
    template <int kPerLane, class Value>
    __device__ float median_of(int count, const Value& value) const {
        std::uint32_t words[kPerLane];  // bits order like non-negative numbers
#pragma unroll
        for (int r = 0; r < kPerLane; ++r) {
            const int i = r * 32 + lane();
            const float v = i < count ? value(i) : 0.0f;
            words[r] = i >= count ? 0xffffffffu : __float_as_uint(v >= 0 ? v + 0.0f : INFINITY);
        }
        // If exactly `lower` words lie at or below the bound, the bound may lie between two words.
        const int lower = count % 2 == 1 ? count / 2 + 1 : count / 2;
        const std::uint32_t bound = kth_word(words, lower);
        std::uint32_t below = 0, above = 0xffffffffu;
        int held = 0;
#pragma unroll
        for (int r = 0; r < kPerLane; ++r) {
            const bool in = words[r] <= bound;
            below = in ? max(below, words[r]) : below;
            above = in ? above : min(above, words[r]);
            held += __popc(__ballot_sync(kAll, in));
        }
        below = ~warp_min(~below), above = warp_min(above);
        if (count % 2 == 1) return __uint_as_float(below);
        // More than half of the words lie at or below the bound: both middle words equal it.
        if (held > lower) above = below;
        return (__uint_as_float(below) + __uint_as_float(above)) / 2;
    }
    __device__ static int append(std::uint64_t* out, std::uint64_t key, bool accepted) {
        const unsigned mask = __ballot_sync(kAll, accepted);
        if (accepted) out[__popc(mask & ((1u << (threadIdx.x % 32)) - 1))] = key;
        return __popc(mask);
    }
    /// Exchanges values with the lane kDistance away, then nearer: 4 kDistance values become 2.
    template <int kDistance, class T>
    __device__ __forceinline__ static void halve(T* values) {
        const bool upper = (threadIdx.x & kDistance) != 0;
#pragma unroll
        for (int i = 0; i < 2 * kDistance; ++i) {
            const T kept = upper ? values[i + 2 * kDistance] : values[i];
            const T given = upper ? values[i] : values[i + 2 * kDistance];
            values[i] = kept + __shfl_xor_sync(kAll, given, kDistance);
        }
        if constexpr (kDistance > 1) halve<kDistance / 2>(values);
    }

    /// The wanted-th smallest word of the lanes, by bisection of their range: about ten rounds.
    template <int kPerLane>
    __device__ std::uint32_t kth_word(const std::uint32_t (&words)[kPerLane], int wanted) const {
        std::uint32_t low = 0xffffffffu, high = 0;
#pragma unroll
        for (int r = 0; r < kPerLane; ++r) low = min(low, words[r]);
#pragma unroll
        for (int r = 0; r < kPerLane; ++r)  // all ones is padding
            high = max(high, words[r] == 0xffffffffu ? 0u : words[r]);
        low = warp_min(low), high = ~warp_min(~high);
        while (low < high) {
            const std::uint32_t middle = low + (high - low) / 2;
            std::uint32_t of_lane = 0;
#pragma unroll
            for (int r = 0; r < kPerLane; ++r) of_lane += words[r] <= middle;
            const int count = int(warp_sum(of_lane));
            if (count >= wanted) {
                high = middle;
                if (count == wanted) break;
            } else {
                low = middle + 1;
            }
        }
        return high;
    }
    /// smallest_first() for keys that fit into the registers of the lanes.
    template <int kPerLane>
    __device__ std::uint64_t select(std::uint64_t* keys, int count, int wanted) const {
        std::uint32_t high[kPerLane], low[kPerLane];
#pragma unroll
        for (int r = 0; r < kPerLane; ++r) {
            const int i = r * 32 + lane();
            const std::uint64_t key = i < count ? keys[i] : ~0ull;
            high[r] = std::uint32_t(key >> 32);
            low[r] = std::uint32_t(key);
        }
        sync();
        const std::uint32_t last = kth_word(high, wanted);
        int below = 0, equal = 0;
#pragma unroll
        for (int r = 0; r < kPerLane; ++r) {
            below += __popc(__ballot_sync(kAll, high[r] < last));
            equal += __popc(__ballot_sync(kAll, high[r] == last));
        }
        std::uint32_t last_low = 0xffffffffu;
        if (below + equal > wanted) {  // ties: by the low words
            std::uint32_t tied[kPerLane];
#pragma unroll
            for (int r = 0; r < kPerLane; ++r) tied[r] = high[r] == last ? low[r] : 0xffffffffu;
            last_low = kth_word(tied, wanted - below);
        }
        int kept = 0;
        std::uint64_t largest = 0;
#pragma unroll
        for (int r = 0; r < kPerLane; ++r) {
            const bool accepted = high[r] < last || (high[r] == last && low[r] <= last_low);
            const std::uint64_t key = std::uint64_t(high[r]) << 32 | low[r];
            const bool real = r * 32 + lane() < count;
            kept += append(keys + kept, key, accepted && real);
            if (accepted && real && key > largest) largest = key;
        }
        sync();
        const std::uint32_t top = ~warp_min(~std::uint32_t(largest >> 32));
        const bool mine = std::uint32_t(largest >> 32) == top;
        return std::uint64_t(top) << 32 | ~warp_min(mine ? ~std::uint32_t(largest) : 0xffffffffu);
    }
};
#else
/// Templates also compile for the host, which never calls them.
struct IdleWarp : SerialWarp {
    static constexpr int kLanes = 32;
    template <class Real>
    using Lane = Real;

    TVSGS_HD static int median_scratch(int /*count*/) { return 0; }
    template <class T>
    static void sums_to_half_lanes(T (&)[32], T (&)[2]) {}
};
using CudaWarp = IdleWarp;
#endif

namespace detail {
/// Blocks that should fit on a multiprocessor; a body with long memory latency sets kMinBlocks.
template <class Body>
constexpr int min_blocks() {
    if constexpr (requires { Body::kMinBlocks; })
        return Body::kMinBlocks;
    else
        return 1;
}

template <class Body>
__global__ void __launch_bounds__(256, min_blocks<Body>())
    warp_kernel(int count, int warp_bytes, const __grid_constant__ Body body) {
    extern __shared__ __align__(16) unsigned char shared[];
    const int in_block = int(threadIdx.x / 32);
    const int i = int(blockIdx.x * (blockDim.x / 32)) + in_block;
    if (i < count)
        body(CudaWarp{}, i, static_cast<void*>(shared + std::size_t(in_block) * warp_bytes));
}
}  // namespace detail

template <class Body>
void for_each_warp(Cuda, int count, std::size_t scratch_bytes, const Body& body) {
    if (count <= 0) return;
    constexpr std::size_t kBlockBytes = 32 << 10;  // below 48 KiB, which need no opt-in
    const std::size_t bytes = (scratch_bytes + 15) / 16 * 16;
    int warps = 8;  // near in space: they share cached memory
    while (warps > 1 && bytes * warps > kBlockBytes) warps /= 2;
    detail::warp_kernel<<<(count + warps - 1) / warps, 32 * warps, bytes * warps>>>(
        count, int(bytes), body);
    check_launch();
}

/// Runs a function of cub with the temporary memory that it asks for: run(memory, bytes).
template <class Run>
void with_temporary(SortScratch<Cuda>& scratch, const Run& run) {
    std::size_t bytes = 0;
    check_cuda(run(nullptr, bytes));
    scratch.temporary.resize(bytes);
    check_cuda(run(scratch.temporary.data(), bytes));
}

inline void sort(Buffer<float, Cuda>& keys, SortScratch<Cuda>& scratch) {
    const int count = int(keys.size());
    if (count == 0) return;
    scratch.floats.resize(keys.size());
    cub::DoubleBuffer<float> both(keys.data(), scratch.floats.data());
    with_temporary(scratch, [&](void* memory, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortKeys(memory, bytes, both, count);
    });
    if (both.Current() != keys.data()) keys.swap(scratch.floats);
}

inline void sort_by_key(Buffer<std::uint64_t, Cuda>& keys,
                        Buffer<std::uint32_t, Cuda>& values,
                        SortScratch<Cuda>& scratch) {
    const int count = int(keys.size());
    if (count == 0) return;
    scratch.keys.resize(keys.size());
    scratch.values.resize(keys.size());
    cub::DoubleBuffer<std::uint64_t> both_keys(keys.data(), scratch.keys.data());
    cub::DoubleBuffer<std::uint32_t> both_values(values.data(), scratch.values.data());
    with_temporary(scratch, [&](void* memory, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortPairs(memory, bytes, both_keys, both_values, count);
    });
    if (both_keys.Current() != keys.data()) keys.swap(scratch.keys);
    if (both_values.Current() != values.data()) values.swap(scratch.values);
}

inline void stable_order(Span<const std::uint32_t> keys,
                         int limit,
                         Span<std::uint32_t> sorted,
                         Span<std::uint32_t> order,
                         Buffer<std::uint32_t, Cuda>& spare,
                         SortScratch<Cuda>& scratch) {
    if (keys.empty()) return;
    const std::size_t count = keys.count, key_bytes = count * sizeof(std::uint32_t);
    spare.resize(2 * count);
    detail::copy(Cuda{}, keys.data, Cuda{}, sorted.data, key_bytes);
    parallel_for(Cuda{}, keys.size(), detail::IotaBody{order});
    cub::DoubleBuffer<std::uint32_t> by_key(sorted.data, spare.data()),
        places(order.data, spare.data() + count);
    with_temporary(scratch, [&](void* memory, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortPairs(memory, bytes, by_key, places, std::int64_t(count),
                                               0, int(std::bit_width(std::uint32_t(limit))));
    });
    if (by_key.Current() != sorted.data)
        detail::copy(Cuda{}, by_key.Current(), Cuda{}, sorted.data, key_bytes);
    if (places.Current() != order.data)
        detail::copy(Cuda{}, places.Current(), Cuda{}, order.data, key_bytes);
}

/// out[i] = term(0) + ... + term(i - 1).
template <class Term>
void exclusive_scan(const Term& term, Buffer<std::int64_t, Cuda>& out, SortScratch<Cuda>& scratch) {
    const auto terms =
        thrust::make_transform_iterator(thrust::make_counting_iterator<std::int64_t>(0), term);
    with_temporary(scratch, [&](void* memory, std::size_t& bytes) {
        return cub::DeviceScan::ExclusiveSum(memory, bytes, terms, out.data(),
                                             std::int64_t(out.size()));
    });
}

}  // namespace tvsgs
