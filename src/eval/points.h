// Clouds of points: their box, and thinning to a minimum distance or to one mean per voxel.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/math/vec.h"

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

}  // namespace tvsgs
