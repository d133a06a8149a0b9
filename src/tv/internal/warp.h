// Warps: 32 threads that work on one splat together. Searches and votes are templates over the Warp
// type: CudaWarp (warp_cuda.h) is a real warp, SerialWarp replaces it by one CPU thread.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/device/buffer.h"
#include "core/device/device.h"
#include "core/device/threads.h"
#include "core/math/abreast.h"

namespace tvsgs {

/// A warp of one lane: one CPU thread.
struct SerialWarp {
    static constexpr int kLanes = 1;
    /// The numbers of one lane. As wide as in WideWarp: the same sums, but slower.
    template <class Real>
    using Lane = Abreast<Pack<Real>, 2>;

    int lane() const { return 0; }
    void sync() const {}  // also orders the lanes' memory accesses
    /// Of a number, or of the numbers of a Pack or Abreast.
    template <class Lane>
    auto sum(const Lane& x) const {
        if constexpr (std::is_arithmetic_v<Lane>) {
            return x;
        } else {
            std::decay_t<decltype(x[0])> total = 0;
            for (int i = 0; i < Lane::kSize; ++i) total += x[i];
            return total;
        }
    }
    template <class T>
    T from_lane(T x, int /*lane*/) const {
        return x;
    }
    /// Sum over the preceding lanes.
    int sum_before(int /*x*/) const { return 0; }
    /// Calls action(0), ..., action(31), each in its own lane on a GPU.
    template <class Action>
    void for_lanes(const Action& action) const {
        for (int i = 0; i < 32; ++i) action(i);
    }
    /// The smallest of value(0), ..., value(31).
    template <class Value>
    std::uint32_t smallest32(const Value& value) const {
        std::uint32_t smallest = value(0);
        for (int i = 1; i < 32; ++i) smallest = std::min(smallest, value(i));
        return smallest;
    }
    static void sort(std::uint32_t* keys, int count) { std::sort(keys, keys + count); }
    /// Bit i is predicate(i), for i in [0, 32).
    template <class Predicate>
    std::uint32_t ballot32(const Predicate& predicate) const {
        std::uint32_t mask = 0;
        for (int i = 0; i < 32; ++i) mask |= predicate(i) ? 1u << i : 0u;
        return mask;
    }
    /// Appends the accepted keys of key(0), ..., key(31) to `out`; returns their number.
    template <class Key, class Accept>
    int append32(std::uint64_t* out, const Key& key, const Accept& accept) const {
        int count = 0;
        for (int i = 0; i < 32; ++i) {
            out[count] = key(i);
            count += accept(out[count]) ? 1 : 0;
        }
        return count;
    }
    static int lowest_bit(std::uint32_t mask) { return __builtin_ctz(mask); }

    /// Moves the `wanted` > 0 smallest of `count` different keys to the front; returns their
    /// largest.
    static std::uint64_t smallest_first(std::uint64_t* keys, int count, int wanted) {
        std::nth_element(keys, keys + wanted - 1, keys + count);
        return keys[wanted - 1];
    }

    /// Numbers of scratch memory for median().
    TVSGS_HD static int median_scratch(int count) { return count; }
    /// Median of value(0), ..., value(count - 1) >= 0, NaN last; of an even count the middle mean.
    template <class Value>
    float median(int count, float* scratch, const Value& value) const {
        for (int i = 0; i < count; ++i) {
            const float v = value(i);
            scratch[i] = v >= 0 ? v : std::numeric_limits<float>::infinity();
        }
        float* upper = scratch + count / 2;
        std::nth_element(scratch, upper, scratch + count);
        return count % 2 == 1 ? *upper : (*std::max_element(scratch, upper) + *upper) / 2;
    }
};

/// For CPUs with has_wide_packs().
struct WideWarp : SerialWarp {
    template <class Real>
    using Lane = Pack<Real, 32>;
};

/// Sorts any number of keys. Batcher's bitonic network whose comparators all put the smaller key
/// first: missing keys up to the next power of two need not exist.
template <class Warp, class Key>
TVSGS_HD void bitonic_sort(const Warp& warp, Key* keys, int count) {
    const auto compare_exchange = [keys, count](int i, int j) {
        if (j >= count || !(keys[j] < keys[i])) return;
        const Key key = keys[i];
        keys[i] = keys[j], keys[j] = key;
    };
    int padded = 1;
    while (padded < count) padded *= 2;
    warp.sync();
    for (int size = 2; size <= padded; size *= 2) {
        for (int pair = warp.lane(); pair < padded / 2; pair += Warp::kLanes) {
            const int rank = pair & (size / 2 - 1), block = 2 * (pair - rank);
            compare_exchange(block + rank, block + size - 1 - rank);
        }
        warp.sync();
        for (int stride = size / 4; stride > 0; stride /= 2) {
            for (int pair = warp.lane(); pair < padded / 2; pair += Warp::kLanes) {
                const int rank = pair & (stride - 1), i = 2 * (pair - rank) + rank;
                compare_exchange(i, i + stride);
            }
            warp.sync();
        }
    }
}

/// Like Warp::median_scratch(). Only a CPU thread needs memory; a warp uses registers.
template <class Device>
int median_scratch(int count) {
    return std::is_same_v<Device, Cpu> ? SerialWarp::median_scratch(count) : 0;
}

/// Calls action(0), ..., action(kCount - 1); a GPU unrolls it, so small arrays stay in registers.
template <int kCount, class Action>
TVSGS_HD void for_constants(const Action& action) {
#if defined(__CUDA_ARCH__)
#pragma unroll
#endif
    for (int j = 0; j < kCount; ++j) action(j);
}

#if !defined(__CUDACC__)
namespace detail {
template <class Body>
TVSGS_WIDE void call_wide(const Body& body, int i, void* scratch) {
    body(WideWarp{}, i, scratch);
}
}  // namespace detail

/// Calls body(warp, i, scratch) for i in [0, count). A body that computes with packs declares
/// kPacks.
template <class Body>
void for_each_warp(Cpu, int count, std::size_t scratch_bytes, const Body& body) {
    [[maybe_unused]] const bool wide = has_wide_packs();
    const std::size_t words = scratch_bytes / sizeof(std::uint64_t) + 1;
    std::vector<std::vector<std::uint64_t>> scratch(thread_count());
    run_ranges(count, 16, [&](int begin, int end, int slot) {
        auto& memory = scratch[slot];
        memory.resize(words);
        for (int i = begin; i < end; ++i) {
            if constexpr (requires { Body::kPacks; }) {
                if (wide) {
                    detail::call_wide(body, i, memory.data());
                    continue;
                }
            }
            body(SerialWarp{}, i, memory.data());
        }
    });
}
#endif

/// Scratch memory of the sorts below.
template <class Device>
struct SortScratch {
    Buffer<unsigned char, Device> temporary;
    Buffer<std::uint64_t, Device> keys;
    Buffer<std::uint32_t, Device> values;
    Buffer<float, Device> floats;
};

/// Sorts in ascending order. The keys contain no NaN.
inline void sort(Buffer<float, Cpu>& keys, SortScratch<Cpu>&) {
    std::sort(keys.span().begin(), keys.span().end());
}

/// Sorts by key, ascending and stable.
inline void sort_by_key(Buffer<std::uint64_t, Cpu>& keys,
                        Buffer<std::uint32_t, Cpu>& values,
                        SortScratch<Cpu>&) {
    std::vector<std::pair<std::uint64_t, std::uint32_t>> pairs(keys.size());
    for (std::size_t i = 0; i < pairs.size(); ++i) pairs[i] = {keys[i], values[i]};
    std::stable_sort(pairs.begin(), pairs.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t i = 0; i < pairs.size(); ++i)
        keys[i] = pairs[i].first, values[i] = pairs[i].second;
}

namespace detail {
struct IotaBody {
    Span<std::uint32_t> values;
    TVSGS_HD void operator()(int i) const { values[i] = std::uint32_t(i); }
};
}  // namespace detail

/// Stable sort of keys below `limit`: `order` gets the places of the keys, `sorted` the keys.
inline void stable_order(Span<const std::uint32_t> keys,
                         int limit,
                         Span<std::uint32_t> sorted,
                         Span<std::uint32_t> order,
                         Buffer<std::uint32_t, Cpu>& /*spare*/,
                         SortScratch<Cpu>&) {
    std::vector<std::size_t> next(std::size_t(limit) + 1, 0);
    for (const std::uint32_t key : keys) ++next[key + std::size_t(1)];
    for (std::size_t key = 0; key + 1 < next.size(); ++key) next[key + 1] += next[key];
    for (std::size_t i = 0; i < keys.count; ++i) {
        const std::size_t to = next[keys[i]]++;
        sorted[to] = keys[i], order[to] = std::uint32_t(i);
    }
}

/// out[i] = term(0) + ... + term(i - 1).
template <class Term>
void exclusive_scan(const Term& term, Buffer<std::int64_t, Cpu>& out, SortScratch<Cpu>&) {
    std::int64_t sum = 0;
    for (std::size_t i = 0; i < out.size(); ++i) {
        out[i] = sum;
        sum += term(std::int64_t(i));
    }
}

}  // namespace tvsgs
