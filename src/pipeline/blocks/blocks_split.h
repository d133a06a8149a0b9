// Splits a coarse run into blocks: chooses the views, start points and fixed splats of each.
// [docs/guide/blocks.md]
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "core/device/device_choice.h"
#include "optim/growth/fixed_splats.h"
#include "pipeline/blocks/blocks_folder.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {

struct SplitOptions {
    int blocks = 0;               // number of blocks; 0: by max_splats
    std::int64_t max_splats = 0;  // expected splats in a cell with its margin
    double margin = 0;            // world units; 0: from cells, votes and voxels
    std::optional<Vec3d> up;      // absent: estimated from the cameras
};

/// Sets cells, frame, near box, margin, voxel size and origin of `manifest` from the splats of the
/// coarse run. `finer`: training width of a view relative to its width in `scene`. `expected`:
/// splats of the whole scene. Throws Error(ExitCode::input) where the scene cannot be cut like
/// that.
void plan_cells(const Scene& scene,
                const Gaussians<Cpu>& coarse,
                const RunOptions& options,
                const SplitOptions& split,
                double finer,
                double expected,
                BlocksManifest& manifest);

struct BlockContents {
    std::vector<int> views;  // indices in scene.train
    PointCloud points;       // start points, in cell and margin
    std::vector<int> fixed;  // coarse splats outside of cell and margin that its views may see
    double expected = 0;     // number of splats
};

/// Returns the contents of each block, in order. `looks`: from find_block_views().
std::vector<BlockContents> fill_blocks(const Scene& scene,
                                       const Gaussians<Cpu>& coarse,
                                       const BlocksManifest& manifest,
                                       double expected,
                                       const std::vector<std::vector<BlockView>>& looks);

/// [block][view]: how much of each block each training view sees, by rendering the depth of the
/// coarse splats.
std::vector<std::vector<BlockView>> find_block_views(const DeviceChoice& device,
                                                     const Scene& scene,
                                                     const Gaussians<Cpu>& coarse,
                                                     const TrainOptions& options,
                                                     const BlocksManifest& manifest);

}  // namespace tvsgs
