// Whether two blocks meet in one surface: how far splats beside a seam lie from the plane of their
// neighbours beyond it, against the same at a cut where there is no seam. [docs/guide/blocks.md]
#pragma once

#include <string>
#include <vector>

#include "core/scene.h"
#include "pipeline/blocks_folder.h"

namespace tvsgs {

/// A splat as surface.
struct SurfaceSplat {
    Vec3d mean;            // relative to the scene's origin, world axes
    Vec2<double> place{};  // on the ground
    int block = 0;         // 1 .. ; 0: far
};

/// Those that make the surface: of an opacity of 0.5 at least.
std::vector<SurfaceSplat> surface_splats(const BlocksManifest& manifest,
                                         const Gaussians<Cpu>& splats);

/// Of these the ones whose centre is in the cell of `block`.
std::vector<SurfaceSplat> surface_of_block(const BlocksManifest& manifest,
                                           const Gaussians<Cpu>& splats,
                                           int block);

/// What votes for a block in the seam pass, as points, whose normals are those of the planes
/// through them: of `splats` those that other blocks keep within twice the reach of votes from its
/// cell.
PointCloud seam_voters(const BlocksManifest& manifest,
                       int block,
                       const std::vector<SurfaceSplat>& splats);

/// Of splats on either side of a cut, against the plane of their 8 nearest beyond it; with that of
/// the 8 nearest on their own side it makes an angle. No axis of a splat is taken for a normal, as
/// not every rasteriser makes them flat.
struct SeamNumbers {
    int compared = 0;                         // splats
    double median_offset = 0, offset_95 = 0;  // |distance from the plane|, world units
    double median_angle = 0;                  // between the planes of either side, degrees
};

struct SeamReport {
    Seam seam;           // cells from 0
    double spacing = 0;  // median distance of splats about the seam, world units
    SeamNumbers across, inside;
    bool judged = false;  // enough splats on all sides
    bool good = true;     // is_good_seam(); true where it is not judged
};

/// Accepted are a median offset of at most 1.25, a 95 % quantile of at most 1.5 times those inside,
/// and a median angle of at most 2 degrees more.
bool is_good_seam(const SeamNumbers& across, const SeamNumbers& inside);

/// Of all neighbours. Splats within two spacings of the seam are compared with those beyond it;
/// inside, the same at a cut through the middle of what each block has beside the seam.
std::vector<SeamReport> test_seams(const std::vector<GroundCell>& cells,
                                   const std::vector<std::pair<int, int>>& neighbours,
                                   const std::vector<SurfaceSplat>& splats);

/// For seams.json.
std::string seams_json(const std::vector<SeamReport>& seams);

}  // namespace tvsgs
