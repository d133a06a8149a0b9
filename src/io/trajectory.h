// Camera trajectories and transforms of Tanks and Temples.  [Knapitsch17]
#pragma once

#include <string>
#include <vector>

#include "core/affine.h"

namespace tvsgs {

struct TrajectoryPose {
    int index = 0;           // the first number of its header line
    bool registered = true;  // the second number is -1 where it is not
    Affine3d world_from_camera;
};

/// A .log file: per image three integers, then a 4x4 camera-to-world matrix. Throws
/// Error(ExitCode::input), E_TNT_TRAJ, naming the line.
std::vector<TrajectoryPose> read_trajectory_log(const std::string& path);

/// A text file with a 4x4 matrix whose last row is 0 0 0 1. Throws Error(ExitCode::input),
/// E_TNT_TRANS.
Affine3d read_transform(const std::string& path);

}  // namespace tvsgs
