// What lies infinitely far away behind a scene: found where views from different places see the
// same in the same direction, and made into a map. [docs/method/sky.md]
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "core/scene/scene.h"

namespace tvsgs {

/// What is known of the pixels of a view, in blocks of them.
struct FarPixels {
    /// far: another view sees the same in that direction. open: nothing speaks against that: no
    /// point lies beside, and what other views see there, if any do, is as flat and as bright.
    enum Label : std::uint8_t { unknown, open, far };

    int block_px = 1, width = 0, height = 0;  // [height width] of blocks
    std::vector<Label> labels;

    Label at(int x, int y) const {  // pixels of the view
        const int bx = x / block_px, by = y / block_px;
        return labels[static_cast<std::size_t>((by < height ? by : height - 1) * width +
                                               (bx < width ? bx : width - 1))];
    }
    bool is_far(int x, int y) const { return at(x, y) == far; }
};

struct SkyLook {
    std::vector<FarPixels> views;  // of the training views; empty: not looked for
    /// Far blocks over those with texture that another view would see, were they far; NaN: hardly
    /// any.
    double share = std::numeric_limits<double>::quiet_NaN();
};

/// `points`: of the scene; views are compared where they stand so far apart that even the far ones
/// of them would move by some pixels. `masks`: what is outside of them does not count.
SkyLook look_for_sky(const std::vector<View>& views,
                     const std::vector<Vec3f>& points,
                     bool masks = false);

/// Indices of the points that no view shows where its pixels are far, here and around.
std::vector<std::size_t> points_before_sky(const std::vector<View>& views,
                                           const SkyLook& look,
                                           const std::vector<Vec3f>& points);

/// [size size 3] a SkyMap: the mean of far pixels; where there are none, of open ones; elsewhere
/// what is around.
ImageU8 make_sky(const std::vector<View>& views, const SkyLook& look);

}  // namespace tvsgs
