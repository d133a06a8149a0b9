// Reading of camera trajectories and transforms of Tanks and Temples.  [Knapitsch17]
#pragma once

#include <string>
#include <vector>

#include "core/math/rigid.h"

namespace tvsgs {

/// One image of a trajectory.
struct TrajectoryPose {
    int index = 0;           // first number of the header line
    bool registered = true;  // false if the second number is -1
    Affine3d world_from_camera;
};

/// Reads a .log file: three integers per image, then a 4x4 camera-to-world matrix. Throws
/// Error(ExitCode::input), E_TNT_TRAJ, with the line.
std::vector<TrajectoryPose> read_trajectory_log(const std::string& path);

/// Camera centres of the same images in two frames.
struct CentrePairs {
    std::vector<Vec3d> from, to;
    std::size_t poses = 0, log_poses = 0;  // in the trajectory; in the official log
    std::string matched_by;                // the rule that matched them, in words
};

/// Pairs the cameras of `trajectory`, a .log file or the folder of a COLMAP model, with the cameras
/// of the official log. Equal numbers are paired row by row (a model's images sorted by name), else
/// by the image index (for a model the number in the image's name, counted from 1). Skips
/// unregistered cameras. Throws Error(ExitCode::input), E_TNT_TRAJ, for fewer than 6 pairs.
CentrePairs pair_trajectories(const std::string& trajectory, const std::string& log);

/// Reads a text file with a 4x4 matrix whose last row is 0 0 0 1. Throws Error(ExitCode::input),
/// E_TNT_TRANS.
Affine3d read_transform(const std::string& path);

}  // namespace tvsgs
