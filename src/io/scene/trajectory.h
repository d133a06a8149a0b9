// Camera trajectories and transforms of Tanks and Temples.  [Knapitsch17]
#pragma once

#include <string>
#include <vector>

#include "core/math/affine.h"

namespace tvsgs {

struct TrajectoryPose {
    int index = 0;           // the first number of its header line
    bool registered = true;  // the second number is -1 where it is not
    Affine3d world_from_camera;
};

/// A .log file: per image three integers, then a 4x4 camera-to-world matrix. Throws
/// Error(ExitCode::input), E_TNT_TRAJ, naming the line.
std::vector<TrajectoryPose> read_trajectory_log(const std::string& path);

/// Camera centres of one image each, in two frames.
struct CentrePairs {
    std::vector<Vec3d> from, to;
    std::size_t poses = 0, log_poses = 0;  // of the trajectory; of the official log
    std::string matched_by;                // in words
};

/// Pairs the cameras of `trajectory`, a .log file or the folder of a COLMAP model, with those of
/// the official log: row by row where both have as many (a model's images sorted by name), else by
/// the image index, for a model the number in the image's name, counted from 1. Unregistered ones
/// are left out. Throws Error(ExitCode::input), E_TNT_TRAJ, for fewer than 6 pairs.
CentrePairs pair_trajectories(const std::string& trajectory, const std::string& log);

/// A text file with a 4x4 matrix whose last row is 0 0 0 1. Throws Error(ExitCode::input),
/// E_TNT_TRANS.
Affine3d read_transform(const std::string& path);

}  // namespace tvsgs
