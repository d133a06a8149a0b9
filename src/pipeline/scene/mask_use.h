// What masks are used for beside meshing: checks, and what stereo and the initial cloud do with
// them. [docs/method/masks.md]
#pragma once

#include "pipeline/run/run_options.h"

namespace tvsgs {

/// Throws Error(ExitCode::input) where masks are to be used, as `asked` says, and there are none,
/// or one has no pixel of the object. `without`: what does without them.
void require_masks(const std::string& asked, const std::string& without, const MaskLook& look);

/// As require_masks(), and where masks are of an object and leave nothing out. Throws
/// Error(ExitCode::usage) for a random background without object masks: here the plan has decided,
/// if there is one. Warns of views without a mask.
void check_masks(const PhotometricOptions& options, const std::vector<View>& train);

/// Stereo with the masks where training has them.
inline StereoOptions stereo_options(const RunOptions& options) {
    StereoOptions stereo = options.stereo;
    stereo.use_masks = stereo.use_masks || uses_masks(options.train.loss.photometric.masks);
    return stereo;
}

/// Takes the points away that a view shows where its mask says background, up to a pixel beside the
/// object. Returns how many.
std::size_t drop_background_points(const std::vector<View>& views, PointCloud& cloud);

/// The same of a cloud to begin with, where training has object masks; says so.
void keep_to_object(MaskUse use, const std::vector<View>& views, PointCloud& cloud);

}  // namespace tvsgs
