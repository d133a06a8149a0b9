// Formulas of the terms that go by the order of depths: pairs of pixels, and the patches that they
// are drawn in.  [FatesGS]
#pragma once

#include <cmath>

#include "optim/losses/depth_prior_math.h"
#include "optim/losses/multiview_math.h"

namespace tvsgs {

/// [|D_b - D_a| - tolerance]+ of two depths; the slope is by the second one, that by the first is
/// its negative.
template <class Real>
TVSGS_HD Penalty<Real> smooth_pair(Real depth_a, Real depth_b, Real tolerance) {
    const Real step = depth_b - depth_a, out = std::abs(step) - tolerance;
    if (!(out > 0)) return {};
    return {out, step > 0 ? Real(1) : Real(-1)};
}

inline constexpr int kRankPatch = 32;  // px
inline constexpr int kRankPixels = kRankPatch * kRankPatch, kRankPairs = kRankPixels / 2;

/// Whole patches in the middle of an image.
struct PatchGrid {
    int left, top, across, down;

    TVSGS_HD int pairs() const { return across * down * kRankPairs; }
};

/// As many as fit, less `fewer` along each axis. With 1 fewer the patches lie half a patch off
/// those of the full grid.
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

/// Pair `i` of a grid. `key` permutes the pixels of a patch, of all patches alike; each pixel of
/// the grid is in one pair.
TVSGS_HD inline PixelPair pixel_pair(const PatchGrid& grid, int width, int i, const Random4& key) {
    const int patch = i / kRankPairs, k = i % kRankPairs;
    const int left = grid.left + kRankPatch * (patch % grid.across),
              top = grid.top + kRankPatch * (patch / grid.across);
    const auto pixel = [&](int place) {
        const int in_patch = static_cast<int>(
            permuted(static_cast<std::uint32_t>(place), std::uint32_t{kRankPixels}, key));
        return (top + in_patch / kRankPatch) * width + left + in_patch % kRankPatch;
    };
    // Places next to each other: permuted() parts them best.
    return {pixel(2 * k), pixel(2 * k + 1)};
}

}  // namespace tvsgs
