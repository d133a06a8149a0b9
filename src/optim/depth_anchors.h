// Where a prior is fitted to a rendered depth map, and the fit.
// [docs/method/vggs.md#anchored-depth]
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "optim/depth_prior_math.h"
#include "optim/depth_prior_options.h"

namespace tvsgs {

/// Least confidence of an anchor, and of the best pixel of a grid's cell.
inline constexpr float kAnchorConfidence = 0.2f, kCellConfidence = 0.6f;

/// Fewer anchors do not make a fit.
inline constexpr std::size_t kLeastAnchors = 6;

/// Pixels to fit at, best first; `confidence` [height width] is 0 where there is none. Pixels of
/// equal confidence go by their place. Empty where there are too few: 30 pixels of top30, 6 cells.
std::vector<int> choose_anchors(AnchorChoice choice,
                                int width,
                                int height,
                                const std::vector<float>& confidence);

/// depth ~ slope * prior + offset, in double.
struct AffineFit {
    double slope = 0, offset = 0;
    std::vector<double> weights;  // of the anchors in the last round; 1: fully believed
};

/// Empty for fewer than kLeastAnchors, where the priors hardly differ (their variance is not above
/// 1e-6, of a range of 1), and where they would have to be turned round (slope <= 0).
std::optional<AffineFit> fit_affine(AnchorFit fit,
                                    const std::vector<double>& prior,
                                    const std::vector<double>& depth);

/// The fit with what follows from how well it meets the anchors that it believes: the largest gap
/// is how far a render may be off; the mean error of the `nearest` smallest ones is the correction
/// where a render is not believed.
DepthAlignment<double> align(const AffineFit& fit,
                             const std::vector<double>& prior,
                             const std::vector<double>& depth,
                             int nearest);

}  // namespace tvsgs
