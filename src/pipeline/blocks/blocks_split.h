// From a coarse run to blocks: what each trains on, sees and is surrounded by.
// [docs/guide/blocks.md]
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "core/device/parallel.h"
#include "core/progress.h"
#include "optim/growth/fixed_splats.h"
#include "pipeline/blocks/blocks_folder.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {

struct SplitOptions {
    int blocks = 0;               // as many; 0: by max_splats
    std::int64_t max_splats = 0;  // expected in a cell with its margin
    double margin = 0;            // world units; 0: by cells, votes and voxels
    std::optional<Vec3d> up;      // none: by the cameras
    double least_share = 0.1;     // of the pixels of a view that is a block's
};

/// Cells, frame, near box, margin, voxel size and origin of `manifest`, by the splats of the coarse
/// run. `finer`: training width of a view over that of `scene`. `expected`: splats of the whole.
/// Throws Error(ExitCode::input) where the scene cannot be cut like that.
void plan_cells(const Scene& scene,
                const Gaussians<Cpu>& coarse,
                const RunOptions& options,
                const SplitOptions& split,
                double finer,
                double expected,
                BlocksManifest& manifest);

/// What is looked for of a block.
struct BlockContents {
    std::vector<int> views;  // of scene.train
    PointCloud points;       // to begin with, in cell and margin
    std::vector<int> fixed;  // coarse splats outside of these that its views may see
    double expected = 0;     // splats
};

/// Each block's, in their order. `looks`: of look_at_blocks().
std::vector<BlockContents> fill_blocks(const Scene& scene,
                                       const Gaussians<Cpu>& coarse,
                                       const BlocksManifest& manifest,
                                       const SplitOptions& split,
                                       double expected,
                                       const std::vector<std::vector<BlockView>>& looks);

/// Coarse splats of each cell whose views are counted: evenly chosen, at most `most` of each.
std::vector<std::vector<int>> counted_splats(const Gaussians<Cpu>& coarse,
                                             const BlocksManifest& manifest,
                                             std::size_t most = 20000);

/// Adds what view `v` shows of each block: `depth` lies on the rays of `camera`.
void look_with_view(const Gaussians<Cpu>& coarse,
                    const BlocksManifest& manifest,
                    const std::vector<std::vector<int>>& counted,
                    const Camera& camera,
                    const std::vector<float>& depth,
                    std::size_t v,
                    std::vector<std::vector<BlockView>>& looks);

/// [block][view]: renders the depth of the coarse splats in each training view.
template <class Device>
std::vector<std::vector<BlockView>> look_at_blocks(const Scene& scene,
                                                   const Gaussians<Cpu>& coarse,
                                                   const TrainOptions& options,
                                                   const BlocksManifest& manifest) {
    std::vector<std::vector<BlockView>> looks(static_cast<std::size_t>(manifest.count()),
                                              std::vector<BlockView>(scene.train.size()));
    const auto counted = counted_splats(coarse, manifest);
    const auto backbone = make_backbone<Device>(options.backbone, options.render);
    Gaussians<Device> splats;
    copy(coarse, splats);
    Progress progress("what the views see of the blocks", static_cast<double>(scene.train.size()));
    for (std::size_t v = 0; v < scene.train.size(); ++v) {
        progress.advance();
        const auto& images = backbone->forward(splats, scene.train[v].camera, 0, kGeometryMaps);
        look_with_view(coarse, manifest, counted, images.camera, to_host(images.depth), v, looks);
    }
    return looks;
}

}  // namespace tvsgs
