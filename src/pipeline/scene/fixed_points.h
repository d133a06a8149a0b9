// Reads measured points that vote (LiDAR, photogrammetry), compares them with the scene, and adds
// start points where the initial cloud has gaps.  [docs/method/voting.md#fixed-voters]
#pragma once

#include <string>

#include "pipeline/run/run_options.h"

namespace tvsgs {

/// Fills scene.fixed_voters from the file tv.fixed_voters (any format of read_mesh()), without
/// unusable points, see drop_invalid_points(). Does nothing if the key is empty. Throws
/// Error(ExitCode::usage) where voting is off, and Error(ExitCode::input) like read_mesh() and
/// make_fixed_voters().
void read_fixed_points(const RunOptions& options, Scene& scene);

/// Fills scene.fixed_splats from init.fixed_splats; does nothing if the key is empty. Throws like
/// read_splats().
void read_fixed_splats(const RunOptions& options, Scene& scene);

/// Agreement of the measured points with the initial cloud. A point agrees if the other cloud has a
/// point within two pixels, or within twice that cloud's spacing. Tests the measured points that
/// two views see, and the initial points inside their box; uses the smaller share.
struct FixedPointsAgreement {
    double in_two_views = 0;  // share of the measured points
    int compared = 0;         // number of tested points
    double agreeing = 0;      // share of them that agrees
    double tolerance_px = 0;  // median
    double better = 0;        // largest share in any tried frame
    std::string frame;        // that frame in words; empty: the file's frame is best
};
/// Compares scene.fixed_voters with the initial cloud. Tries other frames: swapped and rotated
/// axes, other units, and the similarity found by ICP from the file's frame.
FixedPointsAgreement compare_fixed_points(const Scene& scene);

/// Throws Error(ExitCode::input), naming `path`, where the points do not agree with the initial
/// cloud, or agree clearly better in another frame. Partial, denser and sparser clouds pass.
void check_fixed_points(const FixedPointsAgreement& look,
                        std::size_t points,
                        const std::string& path);

/// Adds measured points to the initial cloud, with the mean colour of the views that see them:
/// points seen by a training view that are farther from the cloud than the measured spacing and
/// than three spacings of the cloud. Returns their number.
std::size_t fill_with_fixed_points(Scene& scene);

}  // namespace tvsgs
