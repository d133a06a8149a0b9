// Checks photographs and masks, and removes points outside of masks from stereo and initial clouds.
// [docs/method/masks.md]
#pragma once

#include "pipeline/run/run_options.h"

namespace tvsgs {

/// Throws Error(ExitCode::input) if the training photographs are a few pixels wide, if all are
/// blank, or if all have the same pixels. Warns if some are blank, or repeat others.
void check_photographs(const std::vector<View>& train);

/// Throws Error(ExitCode::input) if most training views have a pose that contradicts the points
/// that they saw. `scene`: for the message.
void check_poses(const std::string& scene, const std::vector<View>& train);

/// Throws Error(ExitCode::input) if no mask has a pixel of the object.
void require_some_object(const MaskLook& look);

/// Throws Error(ExitCode::input) where masks are required and missing, or a mask has no pixel of
/// the object. `asked`: the option that requires them; `without`: the alternative; both for the
/// message.
void require_masks(const std::string& asked, const std::string& without, const MaskLook& look);

/// Like require_masks(); also throws where object masks exclude no pixel. Throws
/// Error(ExitCode::usage) for a random background without object masks; the plan must be resolved
/// before. Warns of views without a mask.
void check_masks(const PhotometricOptions& options, const std::vector<View>& train);

/// Stereo options, with masks if training uses them.
inline StereoOptions stereo_options(const RunOptions& options) {
    StereoOptions stereo = options.stereo;
    stereo.use_masks = stereo.use_masks || uses_masks(options.train.loss.photometric.masks);
    return stereo;
}

/// Removes points that a view shows on its mask's background, more than a pixel away from the
/// object. Returns their number.
std::size_t drop_background_points(const std::vector<View>& views, PointCloud& cloud);

/// Calls drop_background_points() if training uses object masks; logs the result.
void limit_to_object(MaskUse use, const std::vector<View>& views, PointCloud& cloud);

}  // namespace tvsgs
