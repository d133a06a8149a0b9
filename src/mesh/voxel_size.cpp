#include "mesh/voxel_size.h"

#include <algorithm>

namespace tvsgs {

float voxel_size(float given, int resolution, float extent, const std::vector<View>& views) {
    if (given > 0) return given;
    if (resolution > 0) return extent / static_cast<float>(resolution);
    constexpr int kMeshResolution = 2048;  // twice that of 2DGS and FatesGS
    float focal_px = kMeshResolution / 2.0f;
    for (const View& view : views) focal_px = std::min(focal_px, view.camera.fx_px);
    return extent / static_cast<float>(std::max(8, static_cast<int>(2 * focal_px)));
}

}  // namespace tvsgs
