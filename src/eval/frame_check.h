// Are two clouds in one frame at all? Answers with the measured offset.
#pragma once

#include <string>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

struct FrameCheck {
    Vec3d offset{};            // centre of the prediction minus that of the truth
    double size_ratio = 1;     // of the diagonals, prediction over truth
    bool apart = false;        // the boxes do not meet
    Vec3d lower[2], upper[2];  // boxes of prediction and truth

    /// Neither apart, nor of sizes so different (20 times) that a unit must be wrong.
    bool plausible() const { return !apart && size_ratio > 0.05 && size_ratio < 20; }

    /// Boxes, offset and ratio in words.
    std::string text() const;
};

/// Compares the boxes that hold the middle 90 % of the points along each axis, so that strays do
/// not count. Neither may be empty.
FrameCheck check_frame(const std::vector<Vec3d>& prediction, const std::vector<Vec3d>& truth);

}  // namespace tvsgs
