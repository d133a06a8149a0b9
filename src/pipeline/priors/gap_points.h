// Fills the gaps of a stereo cloud, so that pictures have no holes.  [docs/method/support.md#gaps]
#pragma once

#include <vector>

#include "core/scene/scene.h"
#include "mvs/stereo/patch_match.h"
#include "optim/photo/sky.h"

namespace tvsgs {

/// Adds points of confidence 0 to the cloud: one per `spacing_px` x `spacing_px` pixels of the
/// views' completed_maps() that no point covers. A point covers a pixel if it projects to at most
/// one pixel away, and the completed surface lies at most 5 % behind it. The points lie at the
/// completed depth, with its normal and the photograph's colour; depth edges get none, nor do
/// pixels that measured ones do not enclose: less than 60 % of those up to 6 pixels away. A view
/// without a measured pixel adds nothing. `sky`: pixels labelled far get no point; without views:
/// unknown. Returns the number of added points.
std::size_t add_gap_points(const std::vector<StereoMaps>& completed,
                           const std::vector<View>& views,
                           const SkyDetection& sky,
                           int spacing_px,
                           PointCloud& cloud);

}  // namespace tvsgs
