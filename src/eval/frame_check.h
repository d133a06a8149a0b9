// Checks whether two clouds can be in one frame, and measures their offset.
#pragma once

#include <string>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

struct FrameCheck {
    Vec3d offset{};            // centre of the prediction minus centre of the truth
    double size_ratio = 1;     // of the diagonals, prediction over truth
    bool apart = false;        // the boxes do not overlap
    Vec3d lower[2], upper[2];  // boxes of prediction and truth

    /// Whether the boxes overlap and their sizes differ by less than 20 times, else a unit is
    /// wrong.
    bool plausible() const { return !apart && size_ratio > 0.05 && size_ratio < 20; }

    /// Boxes, offset and ratio as text.
    std::string text() const;
};

/// Compares boxes of the middle 90 % of the points along each axis, so that outliers do not count.
/// Neither cloud may be empty.
FrameCheck check_frame(const std::vector<Vec3d>& prediction, const std::vector<Vec3d>& truth);

}  // namespace tvsgs
