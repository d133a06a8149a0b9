// Clouds of points: their box, thinning to a minimum distance or to one mean per voxel, and the
// alignment of one with another by a similarity transform.  [Umeyama91; Knapitsch17]
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/math/rigid.h"
#include "core/math/vec.h"
#include "core/scene/crop.h"

namespace tvsgs {

using Points = std::vector<Vec3d>;

/// Bounding box of at least one point.
struct PointBounds {
    Vec3d lower, upper;
};
PointBounds bounds_of(const Points& points);

/// "(x, y, z)".
std::string point_text(Vec3d p);

/// Visits the points in random order by `seed` (absent: in the given order), and keeps a point
/// unless a kept one lies within `radius`. Returns the indices of the kept points, ascending.
/// [DTUeval: reducePts]
std::vector<std::uint32_t> thin_points(const Points& points,
                                       double radius,
                                       std::optional<std::uint64_t> seed);

/// Mean of the points in each occupied voxel, ordered by voxel (x, then y, then z). The grid starts
/// half a voxel below the smallest coordinates, as in Open3D. Throws Error(ExitCode::input) where a
/// side has more than 2^21 voxels.
Points voxel_means(const Points& points, double voxel);

/// The similarity T with the least squared distances from T * from[i] to to[i]; empty where the
/// points do not determine it.  [Umeyama91]
std::optional<Affine3d> fit_similarity(const Points& from, const Points& to);

/// Result of align_centres().
struct CentreAlignment {
    Affine3d to_from_from;
    int inliers = 0;
    double rmse = 0;             // of the inliers
    double median_residual = 0;  // of all pairs
    bool refined = false;        // false: too few inliers to refit
};

/// Aligns matching camera centres, at least 6 pairs. First fits all pairs; unless all are inliers
/// (closer than `threshold`), runs RANSAC with 100,000 draws of six pairs (`seed`) and refits to
/// the inliers. Throws Error(ExitCode::input), E_TNT_TRAJ, when no draw determines a similarity.
CentreAlignment align_centres(const Points& from,
                              const Points& to,
                              double threshold,
                              std::uint64_t seed);

struct IcpOptions {
    double max_distance = 0;
    int max_iterations = 30;
    // Iterations end when both changes fall below these.
    double fitness_change = 1e-6, rmse_change = 20;
};

struct IcpResult {
    Affine3d target_from_source;
    std::int64_t source = 0, target = 0;  // points
    double fitness = 0;                   // share of the source with a partner
    double rmse = 0;                      // of the pairs
    int iterations = 0;
};

/// Point-to-point ICP with scale.  [Open3D: RegistrationICP]
IcpResult icp(const Points& source, const Points& target, const IcpOptions& options);

/// Applies T to every point; returns the points inside the crop.
Points transformed(const Points& points, const Affine3d& T);
Points cropped(const Points& points, const Crop& crop);

/// Difference of S and T: ratio of scales, angle between rotations, and displacement of `point`.
struct MotionDifference {
    double scale = 1, angle_rad = 0, shift = 0;
};
MotionDifference difference(const Affine3d& S, const Affine3d& T, Vec3d point);

}  // namespace tvsgs
