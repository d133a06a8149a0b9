// Who votes for whom.  [tensor voting specification, section 2]
#pragma once

#include <cstdint>

#include "core/buffer.h"
#include "tv/morton_tree.h"
#include "tv/splats.h"
#include "tv/warp.h"

namespace tvsgs {

/// Lists of one search; they hold until the number or the order of the splats changes.
template <class Device>
struct Neighbours {
    int k = 0;       // receivers of each usable splat: min(asked for, usable splats - 1)
    int usable = 0;  // splats that take part
    Buffer<std::uint32_t, Device>
        receivers;  // [N, k] of voter i; in no defined order, undefined for unusable splats
    Buffer<std::int64_t, Device> begin;         // [N + 1] where receiver i's voters begin
    Buffer<std::uint32_t, Device> voters;       // [usable * k] ordered by voter
    float largest_trace = 0, median_trace = 0;  // of the usable splats' covariances
};

/// Scratch memory of the search, kept between calls.
template <class Device>
struct NeighbourScratch {
    SortScratch<Device> sort;
    Buffer<float, Device> values;  // [N] sorted: traces, then coordinates of one axis
    Buffer<float, Device> stats;   // median and largest trace, then quantiles
    Buffer<double, Device> sums;   // partial sums and their total
    Buffer<std::uint64_t, Device> codes;
    Buffer<std::uint32_t, Device> order;
    Buffer<TreePoint, Device> points;
    Buffer<TreeNode, Device> nodes;
    Buffer<int, Device> cursors;
};

/// For each usable splat the 2k nearest others, and among them the k nearest in its whitened space;
/// ties by index. Exact for all inputs; splats with values that are not finite are left out.
/// `noise` points to the global regulariser of the whitening, on the device. With fewer than two
/// usable splats k is 0.
void find_neighbours(const SplatSpans& splats,
                     int k,
                     const WhitenRule& rule,
                     const double* noise,
                     NeighbourScratch<Cpu>& scratch,
                     Neighbours<Cpu>& out);
void find_neighbours(const SplatSpans& splats,
                     int k,
                     const WhitenRule& rule,
                     const double* noise,
                     NeighbourScratch<Cuda>& scratch,
                     Neighbours<Cuda>& out);

}  // namespace tvsgs
