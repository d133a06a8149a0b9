// Chooses the pixels (anchors) where a depth prior is fitted to a rendered depth map, and fits it.
// [docs/method/vggs.md#anchored-depth]
#pragma once

#include <optional>
#include <vector>

#include "optim/losses/depth_prior_math.h"

namespace tvsgs {

/// Least confidence of an anchor.
inline constexpr float kAnchorConfidence = 0.2f;

/// Fewer anchors give no fit.
inline constexpr std::size_t kLeastAnchors = 6;

/// Of the 30 pixels with the largest confidence the first 15, and 5 of the others far from each
/// other; none for fewer than 30. `confidence` [height width] is 0 where unknown; ties by index.
std::vector<int> choose_anchors(int width, const std::vector<float>& confidence);

/// depth ~ slope * prior + offset, in double.
struct AffineFit {
    double slope = 0, offset = 0;
};

/// Least-squares fit. Empty for fewer than kLeastAnchors anchors, for priors with a variance of at
/// most 1e-6 (their range is 1), and for a slope <= 0, which would reverse the order.
std::optional<AffineFit> fit_affine(const std::vector<double>& prior,
                                    const std::vector<double>& depth);

/// The fit with its tolerances: the largest error at an anchor, and the mean of the `nearest`
/// smallest errors as the correction.
DepthAlignment<double> align(const AffineFit& fit,
                             const std::vector<double>& prior,
                             const std::vector<double>& depth,
                             int nearest);

}  // namespace tvsgs
