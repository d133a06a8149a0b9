// Origin to subtract from a scene far from zero, for example in UTM coordinates, so that float
// keeps its precision.
#pragma once

#include <algorithm>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// Zero unless the places (for example camera centres) lie more than 100 of their radii from zero;
/// up to there float loses fewer than 7 of its 24 bits. Otherwise the mean of the places, rounded
/// to few digits. A single place has radius 1.
inline Vec3d local_origin(const std::vector<Vec3d>& places) {
    Vec3d mean;
    for (const Vec3d p : places) mean += p / static_cast<double>(places.size());
    double radius = 0;
    for (const Vec3d p : places) radius = std::max(radius, norm(p - mean));
    if (radius == 0) radius = 1;
    if (!(norm(mean) > 100 * radius)) return {};
    const double unit = std::exp2(std::floor(std::log2(radius)));
    for (int axis = 0; axis < 3; ++axis) mean[axis] = unit * std::nearbyint(mean[axis] / unit);
    return mean;
}

}  // namespace tvsgs
