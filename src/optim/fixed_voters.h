// Measured points that vote: surveyed geometry as a constraint.
#pragma once

#include <string>

#include "core/scene.h"
#include "tv/voting.h"

namespace tvsgs {

/// Points whose position is not finite are dropped. Normals that are absent or zero are those of
/// the plane through the 12 nearest points. A point stands for a disc whose radius is the root mean
/// square distance to its three nearest. Confidences are the weights; absent: 1. Throws
/// Error(ExitCode::input), naming `path`, with fewer than three points or a weight below 0 or not
/// finite.
FixedVoters make_fixed_voters(const PointCloud& cloud, const std::string& path);

}  // namespace tvsgs
