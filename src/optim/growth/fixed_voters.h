// Measured points that vote: surveyed geometry as a constraint.
#pragma once

#include "core/scene/scene.h"
#include "tv/voting.h"

namespace tvsgs {

/// Points whose position is not finite are dropped. Normals that are absent or zero are those of
/// the plane through the 12 nearest points. A point stands for a disc whose radius is the root mean
/// square distance to its three nearest. Weights are options.fixed_weight times the confidences;
/// absent: 1. Throws Error(ExitCode::input), naming options.fixed_voters, with fewer than three
/// points or a weight below 0 or not finite.
FixedVoters make_fixed_voters(const PointCloud& cloud, const TvOptions& options);

}  // namespace tvsgs
