// What masks are used for beside meshing: checks, and what stereo and the initial cloud do with
// them. [docs/method/masks.md]
#pragma once

#include "pipeline/run_options.h"

namespace tvsgs {

/// Throws Error(ExitCode::input) where masks are to be used and there are none, or one has no pixel
/// of the object. Warns of views without one.
void check_masks(MaskUse use, const std::vector<View>& train);

/// Stereo with the masks where training has them.
inline StereoOptions stereo_options(const RunOptions& options) {
    StereoOptions stereo = options.stereo;
    stereo.use_masks = stereo.use_masks || uses_masks(options.train.loss.photometric.masks);
    return stereo;
}

/// Takes the points away that a view shows where its mask says background, up to a pixel beside the
/// object. Returns how many.
std::size_t drop_background_points(const std::vector<View>& views, PointCloud& cloud);

}  // namespace tvsgs
