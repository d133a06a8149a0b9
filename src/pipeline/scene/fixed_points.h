// Measured points that vote (LiDAR, photogrammetry): read, held against the scene, and where the
// initial cloud is empty made points to begin with.  [docs/method/voting.md#fixed-voters]
#pragma once

#include <string>

#include "pipeline/run/run_options.h"

namespace tvsgs {

/// Fills scene.fixed_voters from tv.fixed_voters, a file that read_mesh() knows, without what
/// drop_unusable() drops; nothing where the key is empty. Throws Error(ExitCode::usage) where
/// nothing votes, Error(ExitCode::input) as read_mesh() and make_fixed_voters() do.
void read_fixed_points(const RunOptions& options, Scene& scene);

/// Fills scene.fixed_splats from init.fixed_splats; nothing where the key is empty. Throws as
/// read_splats() does.
void read_fixed_splats(const RunOptions& options, Scene& scene);

/// How measured points lie to the initial cloud: a point agrees that has one of the other cloud
/// within two pixels, or within twice that cloud's spacing. Asked are the measured points that two
/// views see, and the initial ones inside of their box; the smaller share counts.
struct FixedPointsLook {
    double in_two_views = 0;  // share of the measured points
    int compared = 0;         // points that could agree
    double agreeing = 0;      // their share that does
    double tolerance_px = 0;  // median
    double better = 0;        // the same share, in the frame where it is largest
    std::string frame;        // that frame, in words; empty: no other than the file's
};
/// Of scene.fixed_voters. Frames tried: axes swapped and turned, other units, and what the nearest
/// points ask for, a similarity that begins at the file's frame.
FixedPointsLook look_at_fixed_points(const Scene& scene);

/// Throws Error(ExitCode::input), naming `path`, where the points do not lie on the initial cloud,
/// or would do so clearly better in another frame. Partial and denser or sparser clouds pass.
void check_fixed_points(const FixedPointsLook& look, std::size_t points, const std::string& path);

/// Adds those measured points to the initial cloud that lie farther from it than measured points
/// lie from each other and than three of its own spacings, and that a training view sees, with the
/// mean colour of the views. Returns how many.
std::size_t fill_with_fixed_points(Scene& scene);

}  // namespace tvsgs
