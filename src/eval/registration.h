// Similarities that lay one set of points onto another.  [Umeyama91; Knapitsch17]
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/math/affine.h"
#include "core/scene/crop.h"

namespace tvsgs {

/// The similarity with the least squared distances from T * from[i] to to[i]; none where the points
/// do not determine it (all in one place).  [Umeyama91]
std::optional<Affine3d> fit_similarity(const std::vector<Vec3d>& from,
                                       const std::vector<Vec3d>& to);

/// From matching camera centres.
struct CentreAlignment {
    Affine3d to_from_from;
    int inliers = 0;
    double rmse = 0;             // of the inliers
    double median_residual = 0;  // of all
    bool refined = false;        // false: too few inliers to fit them anew
};

/// RANSAC over six random pairs at a time (100,000 draws of `seed`), then a fit to the inliers,
/// closer than `threshold`; a first fit to all pairs ends it when all are inliers. At least 6
/// pairs. Throws Error(ExitCode::input), E_TNT_TRAJ, when no draw determines a similarity.
CentreAlignment align_centres(const std::vector<Vec3d>& from,
                              const std::vector<Vec3d>& to,
                              double threshold,
                              std::uint64_t seed);

struct IcpOptions {
    double max_distance = 0;
    int max_iterations = 30;
    // Both changes must fall below these for the iterations to end.
    double fitness_change = 1e-6, rmse_change = 20;
};

struct IcpResult {
    Affine3d target_from_source;
    std::int64_t source = 0, target = 0;  // points
    double fitness = 0;                   // share of the source with a partner
    double rmse = 0;                      // of the pairs
    int iterations = 0;
};

/// Point to point, with scale.  [Open3D: RegistrationICP]
IcpResult icp(const std::vector<Vec3d>& source,
              const std::vector<Vec3d>& target,
              const IcpOptions& options);

/// T applied to every point; with a crop, only what it contains.
std::vector<Vec3d> transformed(const std::vector<Vec3d>& points, const Affine3d& T);
std::vector<Vec3d> cropped(const std::vector<Vec3d>& points, const Crop& crop);

/// How far S is from T: ratio of the scales, angle between the rotations, and where `point` went.
struct MotionDifference {
    double scale = 1, angle_rad = 0, shift = 0;
};
MotionDifference difference(const Affine3d& S, const Affine3d& T, Vec3d point);

}  // namespace tvsgs
