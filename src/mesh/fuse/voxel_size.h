// Chooses the voxel size of a mesher.
#pragma once

#include <vector>

#include "core/scene/scene.h"

namespace tvsgs {

/// World units: `given`; else `extent` / `resolution`; if both are 0, `extent` / 2048, but at least
/// `pixels` pixels at half the extent, where the object is. Voxels smaller than a pixel average
/// nothing and hold only noise.
float voxel_size(
    float given, int resolution, float extent, const std::vector<View>& views, float pixels = 1);

}  // namespace tvsgs
