#pragma once

#include <vector>

namespace tvsgs {

struct DepthMapSpan {
    int width, height;
    float* depth;  // [height width], 0 = none
    float* confidence;
};

/// Clears connected pieces of surface (8 neighbours, depths within 1 %) of fewer than 100
/// pixels.
void remove_small_segments(const std::vector<DepthMapSpan>& maps);

}  // namespace tvsgs
