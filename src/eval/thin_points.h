// Thinning of clouds: to a smallest distance, and to one mean per voxel.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// Visits the points in an order drawn with `seed` (none: as given) and keeps each that has no kept
/// one at a distance of `radius` or less. Returns the indices of the kept ones, ascending.
/// [DTUeval: reducePts]
std::vector<std::uint32_t> thin_points(const std::vector<Vec3d>& points,
                                       double radius,
                                       std::optional<std::uint64_t> seed);

/// The mean of the points in each occupied voxel, in the order of the voxels (x, then y, then z).
/// The grid starts half a voxel below the smallest coordinates, as Open3D's. Throws
/// Error(ExitCode::input) where a side has more than 2^21 voxels.
std::vector<Vec3d> voxel_means(const std::vector<Vec3d>& points, double voxel);

}  // namespace tvsgs
