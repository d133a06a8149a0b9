// Removal of small segments from depth maps.
#pragma once

#include <vector>

namespace tvsgs {

/// One depth map, modified in place.
struct DepthMapSpan {
    int width, height;
    float* depth;  // [height width], 0 = none
    float* confidence;
};

/// Clears connected segments (8 neighbours, depths within 1 %) of fewer than 100 pixels.
void remove_small_segments(const std::vector<DepthMapSpan>& maps);

}  // namespace tvsgs
