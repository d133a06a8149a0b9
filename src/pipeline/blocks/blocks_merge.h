// Takes each block's part of the merged splats: the splats of its cell, blended with the
// neighbours' at the cuts.  [docs/guide/blocks.md]
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/gaussians.h"
#include "pipeline/blocks/blocks_folder.h"

namespace tvsgs {

struct BlockSplats {
    Gaussians<Cpu> splats;       // in Morton order
    std::int64_t own = 0;        // splats with their centre in the cell
    std::int64_t far_reach = 0;  // own splats that reach beyond the margin at three deviations
};

/// Returns the part of `splats` that belongs to a block (0: far splats of the coarse run). A splat
/// within `fade` standard deviations (along a ground axis) of a cut, on either side, gets the share
/// of its optical depth from GroundCell::share(); splats whose opacity falls below 1/255 are
/// dropped. The neighbour's splats have the remaining share. With fade = 0 a splat belongs to the
/// cell of its centre. Drops Gaussians::filter.
BlockSplats part_of_block(const BlocksManifest& manifest,
                          const Gaussians<Cpu>& splats,
                          int block,
                          double fade);

Gaussians<Cpu> join_splats(const std::vector<Gaussians<Cpu>>& parts, int sh_degree);

}  // namespace tvsgs
