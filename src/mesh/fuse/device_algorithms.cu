#include <thrust/device_ptr.h>
#include <thrust/execution_policy.h>
#include <thrust/functional.h>
#include <thrust/reduce.h>
#include <thrust/scan.h>
#include <thrust/sort.h>
#include <thrust/unique.h>

#include "core/device/cuda_runtime.h"
#include "core/error.h"
#include "mesh/fuse/device_algorithms.h"

namespace tvsgs {
namespace {

/// Thrust allocates temporary memory outside of Buffer; this maps its failure to the same exit
/// code.
template <class Action>
auto with_thrust_memory(const Action& action) {
    try {
        return action();
    } catch (const std::bad_alloc&) {
        throw Error(ExitCode::memory,
                    "out of GPU memory while sorting voxel blocks; use smaller images (-r) or "
                    "--device cpu");
    }
}

}  // namespace

void sort_unique(Buffer<std::uint64_t, Cuda>& keys) {
    if (keys.empty()) return;
    const auto begin = thrust::device_pointer_cast(keys.data());
    const auto end = begin + static_cast<std::ptrdiff_t>(keys.size());
    keys.resize(with_thrust_memory([&] {
        thrust::sort(thrust::device, begin, end);
        return static_cast<std::size_t>(thrust::unique(thrust::device, begin, end) - begin);
    }));
}

std::uint64_t exclusive_scan(Buffer<std::uint32_t, Cuda>& counts) {
    if (counts.empty()) return 0;
    const auto begin = thrust::device_pointer_cast(counts.data());
    const auto end = begin + static_cast<std::ptrdiff_t>(counts.size());
    return with_thrust_memory([&] {
        const std::uint64_t total = thrust::reduce(thrust::device, begin, end, std::uint64_t{0},
                                                   thrust::plus<std::uint64_t>());
        thrust::exclusive_scan(thrust::device, begin, end, begin);
        return total;
    });
}

std::int64_t free_bytes(Cuda) {
    std::size_t free = 0, total = 0;
    check_cuda(cudaMemGetInfo(&free, &total));
    return static_cast<std::int64_t>(free);
}

}  // namespace tvsgs
