#include "mesh/fuse/voxel_size.h"

#include <algorithm>

namespace tvsgs {

float voxel_size(
    float given, int resolution, float extent, const std::vector<View>& views, float pixels) {
    if (given > 0) return given;
    if (resolution > 0) return extent / static_cast<float>(resolution);
    float voxels = 2048;  // twice as many as 2DGS and FatesGS
    for (const View& view : views) voxels = std::min(voxels, 2 * view.camera.fx_px / pixels);
    return extent / static_cast<float>(std::max(8, static_cast<int>(voxels)));
}

}  // namespace tvsgs
