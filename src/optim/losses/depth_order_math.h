// Formulas of the terms that compare the order of depths: pixel pairs, and the patches that contain
// them.  [FatesGS]
#pragma once

#include <cmath>

#include "optim/losses/depth_prior_math.h"
#include "optim/losses/multiview_math.h"

namespace tvsgs {

/// [|D_b - D_a| - tolerance]+ of two depths. The slope is by depth_b; negate it for depth_a.
template <class Real>
TVSGS_HD Penalty<Real> smooth_pair(Real depth_a, Real depth_b, Real tolerance) {
    const Real step = depth_b - depth_a, out = std::abs(step) - tolerance;
    if (!(out > 0)) return {};
    return {out, step > 0 ? Real(1) : Real(-1)};
}

inline constexpr int kRankPatch = 32;  // px
inline constexpr int kRankPixels = kRankPatch * kRankPatch, kRankPairs = kRankPixels / 2;

/// A grid of whole patches, centred in an image.
struct PatchGrid {
    int left, top, across, down;

    TVSGS_HD int pairs() const { return across * down * kRankPairs; }
};

/// As many patches as fit, less `fewer` along each axis. With fewer = 1 the patches lie half a
/// patch off the full grid.
inline PatchGrid patch_grid(int width, int height, int fewer) {
    const auto fitting = [fewer](int size) {
        const int patches = size / kRankPatch - fewer;
        return patches > 0 ? patches : 0;
    };
    const int across = fitting(width), down = fitting(height);
    return {(width - kRankPatch * across) / 2, (height - kRankPatch * down) / 2, across, down};
}

struct PixelPair {
    int a, b;  // y * width + x
};

/// Pair `i` of a grid. `key` permutes the pixels of a patch, the same way in all patches; each
/// pixel of the grid is in one pair.
TVSGS_HD inline PixelPair pixel_pair(const PatchGrid& grid, int width, int i, const Random4& key) {
    const int patch = i / kRankPairs, k = i % kRankPairs;
    const int left = grid.left + kRankPatch * (patch % grid.across),
              top = grid.top + kRankPatch * (patch / grid.across);
    const auto pixel = [&](int place) {
        const int in_patch = static_cast<int>(
            permuted(static_cast<std::uint32_t>(place), std::uint32_t{kRankPixels}, key));
        return (top + in_patch / kRankPatch) * width + left + in_patch % kRankPatch;
    };
    // Adjacent places: permuted() separates them best.
    return {pixel(2 * k), pixel(2 * k + 1)};
}

}  // namespace tvsgs
