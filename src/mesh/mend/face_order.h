// Sorts points so that neighbours in the list are close in space.
#pragma once

#include <cstdint>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// Indices of points in Morton order, and their Morton codes.
struct SpatialOrder {
    std::vector<int> places;
    std::vector<std::uint32_t> codes;  // ascending
};

/// Sorts by Morton codes of 2^10 cells along the longest side of the points' box; ties keep their
/// order. The result is the same for any number of threads. Points must be finite.
SpatialOrder spatial_order(const std::vector<Vec3f>& points);

}  // namespace tvsgs
