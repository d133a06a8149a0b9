// Finds pixels infinitely far behind a scene, where views from different places see the same in the
// same direction, and makes a map of them. [docs/method/sky.md]
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "core/scene/scene.h"

namespace tvsgs {

/// Labels of the pixels of a view, in blocks.
struct FarPixels {
    /// far: another view sees the same in that direction. open: may be far: no point lies beside
    /// the block, and other views see it, if at all, as flat and as bright.
    enum Label : std::uint8_t { unknown, open, far };

    int block_px = 1, width = 0, height = 0;  // [height width] of blocks
    std::vector<Label> labels;

    Label at(int x, int y) const {  // pixels of the view
        const int bx = x / block_px, by = y / block_px;
        return labels[(by < height ? by : height - 1) * width + (bx < width ? bx : width - 1)];
    }
    bool is_far(int x, int y) const { return at(x, y) == far; }
};

struct SkyDetection {
    std::vector<FarPixels> views;  // of the training views; empty: not searched
    /// Far blocks / textured blocks that another view would see if far; NaN: too few of these.
    double share = std::numeric_limits<double>::quiet_NaN();
};

/// Labels the pixels of all views. `points`: of the scene; compares views far enough apart to move
/// even the most distant points by some pixels. `masks`: ignores pixels outside of masks.
SkyDetection detect_sky(const std::vector<View>& views,
                        const std::vector<Vec3f>& points,
                        bool masks = false);

/// Indices of the points, without those that a view shows in the middle of a far area.
std::vector<std::size_t> points_outside_sky(const std::vector<View>& views,
                                            const SkyDetection& look,
                                            const std::vector<Vec3f>& points);

/// Returns a SkyMap [size size 3]: the mean of far pixels; where there are none, of open pixels;
/// elsewhere filled from neighbouring texels.
ImageU8 make_sky(const std::vector<View>& views, const SkyDetection& look);

/// Returns a SkyMap [64 64 3] of the blurred photographs: the mean colour within some 10 degrees,
/// and farther away of the nearest directions that a photograph shows; black if no pixel counts.
/// [docs/method/sky.md]
ImageU8 make_soft_background(const std::vector<View>& views);

}  // namespace tvsgs
