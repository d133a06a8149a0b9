// Loops that both devices share: one index, one body. A body is a copyable struct with
// `TVSGS_HD void operator()(int i) const`; the CUDA overloads exist in .cu files only.
#pragma once

#include <algorithm>
#include <cstdint>

#include "core/device/buffer.h"
#include "core/device/threads.h"

#if defined(__CUDACC__)
#include "core/device/cuda_runtime.h"
#endif

namespace tvsgs {

/// Calls body(i) for i in [0, count). Each body must write to its own elements; then the result
/// does not depend on the number of threads.
template <class Body>
void parallel_for(Cpu, int count, const Body& body) {
    run_ranges(count, 256, [&](int begin, int end, int /*slot*/) {
        for (int i = begin; i < end; ++i) body(i);
    });
}

/// Like parallel_for, for few and heavy bodies (tiles, rows).
template <class Body>
void parallel_for_heavy(Cpu, int count, const Body& body) {
    run_chunks(count, [&](int i, int /*slot*/) { body(i); });
}

/// *target += value, safe when several bodies add to one element. Integers only: their sum does not
/// depend on the order, so results stay bit-identical.
TVSGS_HD inline void add_atomically(std::int64_t* target, std::int64_t value) {
#if defined(__CUDA_ARCH__)
    atomicAdd(reinterpret_cast<unsigned long long*>(target),
              static_cast<unsigned long long>(value));
#else
    __atomic_fetch_add(target, value, __ATOMIC_RELAXED);
#endif
}

/// *target = min(*target, value), safe when several bodies write to one element. The result does
/// not depend on their order.
TVSGS_HD inline void min_atomically(std::int64_t* target, std::int64_t value) {
#if defined(__CUDA_ARCH__)
    atomicMin(reinterpret_cast<long long*>(target), static_cast<long long>(value));
#else
    std::int64_t seen = __atomic_load_n(target, __ATOMIC_RELAXED);
    while (value < seen && !__atomic_compare_exchange_n(target, &seen, value, true,
                                                        __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
    }
#endif
}

/// Number of blocks, and of stored partial sums, of a reduction whose shape is fixed.
inline constexpr int kSumBlocks = 256;

/// *sum += scale * (sum of term(i) for i in [0, count)), in double and in a fixed order:
/// bit-identical from run to run and for any number of threads. `partial` must hold kSumBlocks
/// numbers.
template <class Term>
void add_sum(Cpu, int count, const Term& term, double scale, Span<double> partial, double* sum) {
    const int chunk = (count + kSumBlocks - 1) / kSumBlocks;
    const auto sum_block = [&](int block, int /*slot*/ = 0) {
        double s = 0;
        for (int i = block * chunk; i < std::min(count, (block + 1) * chunk); ++i)
            s += static_cast<double>(term(i));
        partial[block] = s;
    };
    if (count > 4096)
        run_chunks(kSumBlocks, sum_block);
    else
        for (int block = 0; block < kSumBlocks; ++block) sum_block(block);
    double total = 0;
    for (int block = 0; block < kSumBlocks; ++block) total += partial[block];
    *sum += scale * total;
}

#if defined(__CUDACC__)

/// Debug builds wait after each launch, so that an error names its kernel.
inline void check_launch(std::source_location where = std::source_location::current()) {
    check_cuda(cudaGetLastError(), where);
#if !defined(NDEBUG)
    check_cuda(cudaDeviceSynchronize(), where);
#endif
}

namespace detail {

template <class Body>
__global__ void for_kernel(int count, Body body) {
    const int i = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
    if (i < count) body(i);
}

/// Sum over a block of 256 threads in a fixed tree. Only thread 0 gets the result.
__device__ inline double block_sum_256(double value) {
    __shared__ double partial[256];
    partial[threadIdx.x] = value;
    for (int stride = 128; stride > 0; stride /= 2) {
        __syncthreads();
        if (threadIdx.x < stride) partial[threadIdx.x] += partial[threadIdx.x + stride];
    }
    return partial[0];
}

template <class Term>
__global__ void partial_sums_kernel(int count, Term term, double* partial) {
    double s = 0;
    for (int i = static_cast<int>(blockIdx.x * 256 + threadIdx.x); i < count; i += kSumBlocks * 256)
        s += static_cast<double>(term(i));
    s = block_sum_256(s);
    if (threadIdx.x == 0) partial[blockIdx.x] = s;
}

template <int kUnused = 0>
__global__ void final_sum_kernel(const double* partial, double scale, double* sum) {
    const double s = block_sum_256(partial[threadIdx.x]);
    if (threadIdx.x == 0) *sum += scale * s;
}

}  // namespace detail

template <class Body>
void parallel_for(Cuda, int count, const Body& body) {
    if (count <= 0) return;
    detail::for_kernel<<<(count + 255) / 256, 256>>>(count, body);
    check_launch();
}

template <class Body>
void parallel_for_heavy(Cuda, int count, const Body& body) {
    parallel_for(Cuda{}, count, body);
}

template <class Term>
void add_sum(Cuda, int count, const Term& term, double scale, Span<double> partial, double* sum) {
    static_assert(kSumBlocks == 256);
    detail::partial_sums_kernel<<<kSumBlocks, 256>>>(count, term, partial.data);
    detail::final_sum_kernel<><<<1, 256>>>(partial.data, scale, sum);
    check_launch();
}

#endif  // __CUDACC__

}  // namespace tvsgs
