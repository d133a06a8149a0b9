// Formulas of the terms that compare depth with a prior.  [docs/method/vggs.md]
#pragma once

#include <cmath>

#include "core/math/rng.h"
#include "core/math/vec.h"
#include "optim/losses/multiview_math.h"

namespace tvsgs {

/// A value and its derivative by its single argument.
template <class Real>
struct Penalty {
    Real value = 0, slope = 0;
};

/// Sign of a - b; 0 where |a - b| < dead_zone.
template <class Real>
TVSGS_HD Real order_sign(Real a, Real b, Real dead_zone) {
    const Real difference = a - b;
    if (!(std::abs(difference) >= dead_zone)) return 0;
    return difference > 0 ? Real(1) : difference < 0 ? Real(-1) : Real(0);
}

/// Separates pairs that are rendered at one depth, length units of the losses.  [FatesGS] [VGGS]
inline constexpr float kOrderMargin = 1e-4f;

/// max(sign * difference + margin, 0), with `difference` = D(q) - D(p) and `sign` that of M(p) -
/// M(q): positive for a pair in the wrong order. Equal priors cost the margin and have no gradient.
/// [VGGS]
template <class Real>
TVSGS_HD Penalty<Real> order_hinge(Real sign, Real difference, Real margin) {
    const Real out = sign * difference + margin;
    if (!(out > 0)) return {};
    return {out, sign};
}

/// Huber penalty of the relative error r = (depth - prior) / prior: r^2 / 2s below s, |r| - s / 2
/// above, so the gradient by r is at most 1. The slope is by depth.
template <class Real>
TVSGS_HD Penalty<Real> relative_huber(Real depth, Real prior, Real s) {
    const Real r = (depth - prior) / prior;
    if (std::abs(r) < s) return {r * r / (2 * s), r / s / prior};
    return {std::abs(r) - s / 2, (r > 0 ? 1 : -1) / prior};
}

struct PixelShift {
    int x, y;
};

/// Uniform in [-reach, reach]^2, with (1, 0) instead of (0, 0).
TVSGS_HD inline PixelShift pixel_shift(const Random4& draw, int reach) {
    const auto whole = [reach](std::uint32_t bits) {
        const int count = 2 * reach + 1;
        const int i = int(uniform(bits) * float(count));
        return (i < count ? i : count - 1) - reach;
    };
    const PixelShift shift{whole(draw.v[0]), whole(draw.v[1])};
    return shift.x == 0 && shift.y == 0 ? PixelShift{1, 0} : shift;
}

/// Maps a prior to the depths of a render, with tolerances for both.
template <class Real>
struct DepthAlignment {
    Real slope, offset;  // aligned = slope * prior + offset
    Real max_gap;        // a render farther from the aligned prior is rejected
    Real correction;     // added to the aligned prior where the render is rejected
};

/// Target depth of a pixel: the render's where it agrees with the aligned prior, else the corrected
/// prior; 0: unknown. A rendered depth of 0 means none.
template <class Real>
TVSGS_HD Real calibrated_depth(const DepthAlignment<Real>& a, Real prior, Real depth) {
    const Real aligned = a.slope * prior + a.offset;
    if (!(aligned > 0) || !(aligned * 0 == 0)) return 0;  // or not finite
    // Allows a relative rounding error of 1e-5.
    if (depth > 0 && std::abs(aligned - depth) <= a.max_gap + Real(1e-5) * depth) return depth;
    const Real corrected = aligned + a.correction;
    return corrected > 0 ? corrected : Real(0);
}

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

/// As many patches as fit, less `fewer` along each axis; 1: half a patch off the full grid.
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
        const int in_patch = int(permuted(std::uint32_t(place), std::uint32_t{kRankPixels}, key));
        return (top + in_patch / kRankPatch) * width + left + in_patch % kRankPatch;
    };
    // Adjacent places: permuted() separates them best.
    return {pixel(2 * k), pixel(2 * k + 1)};
}

}  // namespace tvsgs
