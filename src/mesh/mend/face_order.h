// Faces in an order in which those near each other in space are near each other in the list.
#pragma once

#include <cstdint>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// Places of points, and their Morton codes.
struct SpatialOrder {
    std::vector<int> places;
    std::vector<std::uint32_t> codes;  // ascending
};

/// By Morton codes of 2^10 cells along the longest side of the points' box, ties as given. The same
/// for any number of threads. Points must be finite.
SpatialOrder spatial_order(const std::vector<Vec3f>& points);

}  // namespace tvsgs
