// Strength of edges in a photograph.
#pragma once

#include <cstdint>

#include "core/device/device.h"

namespace tvsgs {

/// Mean over the channels of the absolute difference of two pixels of a photograph [H W 3], 0 to 1.
TVSGS_HD inline float color_difference(const std::uint8_t* photo, int p, int q) {
    int sum = 0;
    for (int c = 0; c < 3; ++c) {
        const int d = photo[3 * p + c] - photo[3 * q + c];
        sum += d < 0 ? -d : d;
    }
    return static_cast<float>(sum) / (3 * 255);
}

/// Strength of the strongest edge through an interior pixel: the larger of the two central
/// differences' channel means, 0 to 1.
TVSGS_HD inline float edge_strength(const std::uint8_t* photo, int width, int x, int y) {
    const int at = y * width + x;
    const float horizontal = color_difference(photo, at + 1, at - 1),
                vertical = color_difference(photo, at + width, at - width);
    return horizontal > vertical ? horizontal : vertical;
}

}  // namespace tvsgs
