// CUDA twins of warp.h. For .cu files only.
#pragma once

#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_scan.cuh>

#include "core/cuda_runtime.h"
#include "core/parallel.h"
#include "tv/warp.h"

namespace tvsgs {

/// One warp, all lanes taking part in every call. The methods compile for the host too, as the
/// templates that use them do, but do nothing there.
struct CudaWarp {
    static constexpr int kLanes = 32;
    static constexpr unsigned kAll = 0xffffffffu;

#if defined(__CUDA_ARCH__)
    __host__ __device__ int lane() const {
        return static_cast<int>(threadIdx.x % 32);
    }
    __host__ __device__ void sync() const {
        __syncwarp();
    }
    __host__ __device__ static int lowest_bit(std::uint32_t mask) {
        return __ffs(static_cast<int>(mask)) - 1;
    }
    __host__ __device__ static int bit_count(std::uint32_t mask) {
        return __popc(mask);
    }
    template <class T>
    __host__ __device__ T sum(T x) const {  // the same tree, hence the same bits, in all lanes
        for (int offset = 16; offset > 0; offset /= 2) x += __shfl_xor_sync(kAll, x, offset);
        return x;
    }
    template <class T>
    __host__ __device__ T from_lane(T x, int source) const {
        return __shfl_sync(kAll, x, source);
    }
    template <class Predicate>
    __host__ __device__ std::uint32_t ballot32(const Predicate& predicate) const {
        return __ballot_sync(kAll, predicate(lane()));
    }
#else
    __host__ __device__ int lane() const {
        return 0;
    }
    __host__ __device__ void sync() const {}
    __host__ __device__ static int lowest_bit(std::uint32_t) {
        return 0;
    }
    __host__ __device__ static int bit_count(std::uint32_t) {
        return 0;
    }
    template <class T>
    __host__ __device__ T sum(T x) const {
        return x;
    }
    template <class T>
    __host__ __device__ T from_lane(T x, int) const {
        return x;
    }
    template <class Predicate>
    __host__ __device__ std::uint32_t ballot32(const Predicate&) const {
        return 0;
    }
#endif
    template <class Action>
    __host__ __device__ void for_each_bit(std::uint32_t mask, const Action& action) const {
        const int i = lane();
        if ((mask >> i & 1u) != 0) action(i, bit_count(mask & ((1u << i) - 1)));
    }
    template <class Key>
    __host__ __device__ void smallest_first(Key* keys, int count, int /*wanted*/) const {
        bitonic_sort(*this, keys, count);
    }
};

namespace detail {
template <class Body>
__global__ void warp_kernel(int count, int warp_bytes, const __grid_constant__ Body body) {
    extern __shared__ __align__(16) unsigned char shared[];
    const int in_block = static_cast<int>(threadIdx.x / 32);
    const int i = static_cast<int>(blockIdx.x * (blockDim.x / 32)) + in_block;
    if (i < count)
        body(CudaWarp{}, i, static_cast<void*>(shared + std::size_t(in_block) * warp_bytes));
}
}  // namespace detail

template <class Body>
void for_each_warp(Cuda, int count, std::size_t scratch_bytes, const Body& body) {
    if (count <= 0) return;
    constexpr std::size_t kBlockBytes = 32 << 10;  // below the 48 KiB that need no opting in
    const std::size_t bytes = (scratch_bytes + 15) / 16 * 16;
    int warps = 4;
    while (warps > 1 && bytes * warps > kBlockBytes) warps /= 2;
    detail::warp_kernel<<<(count + warps - 1) / warps, 32 * warps, bytes * warps>>>(
        count, static_cast<int>(bytes), body);
    check_launch();
}

inline void sort(Buffer<float, Cuda>& keys, SortScratch<Cuda>& scratch) {
    const int count = static_cast<int>(keys.size());
    if (count == 0) return;
    scratch.floats.resize(keys.size());
    std::size_t bytes = 0;
    check_cuda(
        cub::DeviceRadixSort::SortKeys(nullptr, bytes, keys.data(), scratch.floats.data(), count));
    scratch.temporary.resize(bytes);
    check_cuda(cub::DeviceRadixSort::SortKeys(scratch.temporary.data(), bytes, keys.data(),
                                              scratch.floats.data(), count));
    keys.swap(scratch.floats);
}

inline void sort_by_key(Buffer<std::uint64_t, Cuda>& keys,
                        Buffer<std::uint32_t, Cuda>& values,
                        SortScratch<Cuda>& scratch) {
    const int count = static_cast<int>(keys.size());
    if (count == 0) return;
    scratch.keys.resize(keys.size());
    scratch.values.resize(keys.size());
    const auto run = [&](void* temporary, std::size_t& bytes) {
        check_cuda(cub::DeviceRadixSort::SortPairs(temporary, bytes, keys.data(),
                                                   scratch.keys.data(), values.data(),
                                                   scratch.values.data(), count));
    };
    std::size_t bytes = 0;
    run(nullptr, bytes);
    scratch.temporary.resize(bytes);
    run(scratch.temporary.data(), bytes);
    keys.swap(scratch.keys);
    values.swap(scratch.values);
}

/// out[i] = in[0] + ... + in[i - 1]; in place is fine.
inline void exclusive_scan(Buffer<std::int64_t, Cuda>& values, SortScratch<Cuda>& scratch) {
    const int count = static_cast<int>(values.size());
    if (count == 0) return;
    std::size_t bytes = 0;
    check_cuda(cub::DeviceScan::ExclusiveSum(nullptr, bytes, values.data(), values.data(), count));
    scratch.temporary.resize(bytes);
    check_cuda(cub::DeviceScan::ExclusiveSum(scratch.temporary.data(), bytes, values.data(),
                                             values.data(), count));
}

}  // namespace tvsgs
