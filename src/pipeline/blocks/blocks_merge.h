// What the whole takes from each block: the splats of its cell, which fade into the neighbours' at
// the cuts.  [docs/guide/blocks.md]
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/gaussians.h"
#include "pipeline/blocks/blocks_folder.h"

namespace tvsgs {

/// The logit of the opacity that a splat has with `share` (0, 1] of its optical depth:
/// 1 - (1 - opacity)^share. Two splats in one place with shares that sum to 1 let through what the
/// one did.
double faded_logit(double logit, double share);

struct BlockSplats {
    Gaussians<Cpu> splats;       // in Morton order
    std::int64_t own = 0;        // whose centre is in the cell
    std::int64_t far_reach = 0;  // own ones that reach beyond the margin, by three deviations
};

/// The part of `splats` that is of a block (0: of the coarse run, what is far). A splat within
/// `fade` of its standard deviations along a ground axis of a cut of the cell, on either side,
/// keeps the share of its optical depth that GroundCell::share() gives it, and none whose opacity
/// then is below 1/255; the neighbour's have the rest. fade = 0: what has its centre in the cell.
/// Gaussians::filter is dropped.
BlockSplats part_of_block(const BlocksManifest& manifest,
                          const Gaussians<Cpu>& splats,
                          int block,
                          double fade);

/// One after the other.
Gaussians<Cpu> join_splats(const std::vector<Gaussians<Cpu>>& parts, int sh_degree);

}  // namespace tvsgs
