// Completion of a depth map: smooth in inverse depth except at edges of the photograph.
// [docs/method/vggs.md#completed-depth]
#pragma once

#include <cstdint>
#include <vector>

namespace tvsgs {

/// The known part of a view's depth, row by row.
struct SparseDepth {
    int width_px = 0, height_px = 0;
    std::vector<float> depth;        // [H W] z; 0: unknown
    std::vector<float> weight;       // [H W] of known depths, in [0, 1]
    std::vector<float> grey;         // [H W] the photograph, in [0, 1]
    std::vector<std::uint8_t> mask;  // [H W] 128 or more: inside; empty: everything
};

/// The depth that minimises, in inverse depth z,
///     sum over known p of weight (z - 1 / depth)^2
///       + 0.05 * sum over neighbours p, q of exp(-|grey_p - grey_q| / 0.04) (z_p - z_q)^2,
/// by conjugate gradients. Known depths also move slightly. 0 outside the mask, and everywhere if
/// no depth is known. Bit-identical from run to run and for any number of threads.
std::vector<float> complete_depth(const SparseDepth& known);

}  // namespace tvsgs
