// Makes voters from measured points, which constrain the votes.
#pragma once

#include "core/scene/scene.h"
#include "tv/voting.h"

namespace tvsgs {

/// Drops points whose position is not finite. A missing or zero normal becomes the normal of the
/// plane through the 12 nearest points. Each point votes as a disc; its radius is the root mean
/// square distance to its three nearest points. Weights are options.fixed_weight times the
/// confidences (1 if absent). Throws Error(ExitCode::input), naming options.fixed_voters, for fewer
/// than three points or a weight that is negative or not finite.
FixedVoters make_fixed_voters(const PointCloud& cloud, const TvOptions& options);

}  // namespace tvsgs
