// The two devices as types, and the qualifier that compiles one formula for both.
#pragma once

#if defined(__CUDACC__)
#define TVSGS_HD __host__ __device__
#else
#define TVSGS_HD
#endif

namespace tvsgs {

/// Tags. The device of a container is part of its type, and overload resolution picks the version
/// for that device.
struct Cpu {};
struct Cuda {};

#if defined(TVSGS_WITH_CUDA)
inline constexpr bool kHasCuda = true;
#else
inline constexpr bool kHasCuda = false;
#endif

}  // namespace tvsgs
