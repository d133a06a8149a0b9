// Where a scene far from zero, as in UTM coordinates, is moved from, so that float keeps its
// digits.
#pragma once

#include <algorithm>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// Zero unless the places, camera centres say, lie more than 100 of their radii from it: up to
/// there a float loses less than 7 of its 24 bits. Else their mean, rounded so that it is short to
/// write. A single place counts as one of radius 1.
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
