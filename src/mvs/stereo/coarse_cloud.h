// Rough start points for views that overlap too little for patches to match.
#pragma once

#include "core/scene/scene.h"
#include "mvs/stereo/patch_match.h"

namespace tvsgs {

/// Sweeps the range of depths along a coarse grid of rays of each view, where at least half of the
/// views see it that see any point of the ray. A ray gives at most one point: with
/// `options.use_masks` and masks the first inside of all masks (the visual hull), else the one
/// whose mean colour agrees best with other views, if at least three of four others on the ray
/// differ by half of the mean or more. `points`: for the range of depths; may be empty. Throws
/// Error(ExitCode::input) if the range is unknown.
PointCloud coarse_cloud(const std::vector<View>& views,
                        const std::vector<Vec3f>& points,
                        const StereoOptions& options);

}  // namespace tvsgs
