// How large the voxels of a mesher are.
#pragma once

#include <vector>

#include "core/scene/scene.h"

namespace tvsgs {

/// World units: `given`, or `extent` in `resolution` voxels; where these are 0, in 2048, but none
/// smaller than `pixels` pixels at half the extent, where the object is: voxels smaller than one
/// average nothing and hold only noise.
float voxel_size(
    float given, int resolution, float extent, const std::vector<View>& views, float pixels = 1);

}  // namespace tvsgs
