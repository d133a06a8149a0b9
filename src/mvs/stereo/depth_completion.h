// A depth map without holes: smooth in inverse depth, but not across edges of the photograph.
// [docs/method/vggs.md#completed-depth]
#pragma once

#include <cstdint>
#include <vector>

namespace tvsgs {

/// What is known of a view's depth, row by row.
struct SparseDepth {
    int width_px = 0, height_px = 0;
    std::vector<float> depth;        // [H W] z; 0: not known
    std::vector<float> weight;       // [H W] of what is known, in [0, 1]
    std::vector<float> grey;         // [H W] the photograph, in [0, 1]
    std::vector<std::uint8_t> mask;  // [H W] 128 and more: inside; empty: all is
};

/// The depth that minimises, in inverse depth z,
///     sum over known p of weight (z - 1 / depth)^2
///       + 0.05 * sum over neighbours p, q of exp(-|grey_p - grey_q| / 0.04) (z_p - z_q)^2,
/// by conjugate gradients. Known depths move a little, too. 0 outside the mask, and everywhere
/// where no depth is known. The same bits from run to run and for any number of threads.
std::vector<float> complete_depth(const SparseDepth& known);

}  // namespace tvsgs
