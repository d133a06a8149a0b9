// Where a prior is fitted to a rendered depth map, and the fit.
// [docs/method/vggs.md#anchored-depth]
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "optim/losses/depth_prior_math.h"

namespace tvsgs {

/// Least confidence of an anchor.
inline constexpr float kAnchorConfidence = 0.2f;

/// Fewer anchors do not make a fit.
inline constexpr std::size_t kLeastAnchors = 6;

/// Pixels to fit at: of the 30 best the first 15, and 5 of the others far from each other.
/// `confidence` [height width] is 0 where there is none. Pixels of equal confidence go by their
/// place. Empty where there are fewer than 30.
std::vector<int> choose_anchors(int width, const std::vector<float>& confidence);

/// depth ~ slope * prior + offset, in double.
struct AffineFit {
    double slope = 0, offset = 0;
};

/// Least squares. Empty for fewer than kLeastAnchors, where the priors hardly differ (their
/// variance is not above 1e-6, of a range of 1), and where they would have to be turned round
/// (slope <= 0).
std::optional<AffineFit> fit_affine(const std::vector<double>& prior,
                                    const std::vector<double>& depth);

/// The fit with what follows from how well it meets the anchors: the largest gap is how far a
/// render may be off; the mean error of the `nearest` smallest ones is the correction where a
/// render is not believed.
DepthAlignment<double> align(const AffineFit& fit,
                             const std::vector<double>& prior,
                             const std::vector<double>& depth,
                             int nearest);

}  // namespace tvsgs
