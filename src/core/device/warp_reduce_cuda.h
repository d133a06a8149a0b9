// Sums and minima of integers over a warp; one instruction from compute capability 8.0 on.
#pragma once

#include <cstdint>

namespace tvsgs {

/// Sum of `x` over the 32 lanes, returned to every lane. All lanes must call it.
__device__ __forceinline__ std::uint32_t warp_sum(std::uint32_t x) {
#if __CUDA_ARCH__ >= 800
    return __reduce_add_sync(0xffffffffu, x);
#else
    for (int distance = 16; distance > 0; distance /= 2)
        x += __shfl_xor_sync(0xffffffffu, x, distance);
    return x;
#endif
}

/// Smallest `x` of the 32 lanes, returned to every lane. All lanes must call it.
__device__ __forceinline__ std::uint32_t warp_min(std::uint32_t x) {
#if __CUDA_ARCH__ >= 800
    return __reduce_min_sync(0xffffffffu, x);
#else
    for (int distance = 16; distance > 0; distance /= 2)
        x = min(x, __shfl_xor_sync(0xffffffffu, x, distance));
    return x;
#endif
}

}  // namespace tvsgs
