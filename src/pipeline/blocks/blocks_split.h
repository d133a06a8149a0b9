// Splits a coarse run into blocks: chooses the views, start points and fixed splats of each.
// [docs/guide/blocks.md]
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "core/progress.h"
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

/// Inputs of a block.
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

/// Samples the coarse splats of each cell evenly, at most `most` per cell, to count the views that
/// see them.
std::vector<std::vector<int>> counted_splats(const Gaussians<Cpu>& coarse,
                                             const BlocksManifest& manifest,
                                             std::size_t most = 20000);

/// Adds to each block how much of it view `v` sees. `depth`: for the rays of `camera`.
void add_block_view(const Gaussians<Cpu>& coarse,
                    const BlocksManifest& manifest,
                    const std::vector<std::vector<int>>& counted,
                    const Camera& camera,
                    const std::vector<float>& depth,
                    std::size_t v,
                    std::vector<std::vector<BlockView>>& looks);

/// [block][view]: how much of each block each training view sees, by rendering the depth of the
/// coarse splats.
template <class Device>
std::vector<std::vector<BlockView>> find_block_views(const Scene& scene,
                                                     const Gaussians<Cpu>& coarse,
                                                     const TrainOptions& options,
                                                     const BlocksManifest& manifest) {
    std::vector<std::vector<BlockView>> looks(std::size_t(manifest.count()),
                                              std::vector<BlockView>(scene.train.size()));
    const auto counted = counted_splats(coarse, manifest);
    const auto backbone = make_backbone<Device>(options.backbone, options.render);
    Gaussians<Device> splats;
    copy(coarse, splats);
    Progress progress("views per block", double(scene.train.size()));
    for (std::size_t v = 0; v < scene.train.size(); ++v) {
        progress.advance();
        const auto& images = backbone->forward(splats, scene.train[v].camera, 0, kGeometryMaps);
        add_block_view(coarse, manifest, counted, images.camera, to_host(images.depth), v, looks);
    }
    return looks;
}

}  // namespace tvsgs
