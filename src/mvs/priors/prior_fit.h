// Fit of scale and shift of prior depth maps to points of known depth, and detection of the maps'
// convention. [docs/guide/priors.md#how-scale-and-shift-are-found]
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "core/scene/prior_conventions.h"

namespace tvsgs {

/// A point that a view sees, with the map's value there.
struct PriorSample {
    double value;     // of the map, finite
    double depth;     // z, > 0
    double distance;  // along the ray
};
using PriorSamples = std::vector<PriorSample>;

/// Assumed meaning of a map's numbers.
struct PriorReading {
    PriorQuantity quantity = PriorQuantity::depth;
    PriorGeometry geometry = PriorGeometry::z;
    PriorAlignment alignment = PriorAlignment::affine;
};

/// scale * value + shift is the quantity.
struct PriorFit {
    bool found = false;
    double scale = 1, shift = 0;
    /// Median over the points of |found depth / true depth - 1|.
    double residual = std::numeric_limits<double>::infinity();
    /// The same residual for the best constant depth, the median of the points: a map without
    /// information reaches it.
    double residual_of_constant = std::numeric_limits<double>::infinity();
};

/// True if the map explains too little: its residual is more than 0.65 of that of a constant depth.
/// Maps of other photographs of the scene left 0.6 to 2.5 of it, the right maps at most 0.6 even
/// with 5 % noise. Points cannot judge residuals below 0.01.
inline bool is_uninformative(const PriorFit& fit) {
    return fit.found && fit.residual > 0.01 && fit.residual > 0.65 * fit.residual_of_constant;
}

/// Fewest points for a fit.
inline constexpr std::size_t kFewestForScale = 6, kFewestForShift = 12;

/// Robust fit: up to nearly half of the points may be wrong, for example hidden by the surface. It
/// starts from the best of one fit by medians and 100 through two points each, judged by the median
/// error, then runs reweighted least squares (Huber) about the mean, all in double. If the values
/// are almost equal (relative standard deviation of a thousandth), it cannot separate scale and
/// shift and finds only the scale, or the shift for log depth. Not found: too few points, or a
/// scale that is not positive.
PriorFit fit_prior(const PriorSamples& samples, const PriorReading& reading);

/// z of a value; `cosine`: of the angle between ray and axis. 0 if there is no depth.
double prior_depth(double value, const PriorFit& fit, const PriorReading& reading, double cosine);

/// Spearman's rank correlation: 1 if the values grow with depth, -1 if they fall. 0 for fewer than
/// 3 samples.
double rank_correlation(const PriorSamples& samples);

/// The reading that all views share.
struct ReadingChoice {
    PriorReading reading;
    double residual = std::numeric_limits<double>::infinity();  // median over the views
    int tested_views = 0;
};

/// The reading of the files that fits the points. It tries every value that `convention` leaves
/// open. An assumed value gives way to one that most views fit clearly better; depth also gives way
/// to inverse depth if the numbers fall with depth. Without enough points in any view it returns
/// the assumed reading untested. Throws Error(ExitCode::input), E_PRIORS, if another reading than
/// the declared one fits clearly better, if no reading fits within `max_residual`, or if the
/// numbers have the wrong order.
ReadingChoice choose_reading(const std::vector<PriorSamples>& views,
                             const DepthConvention& convention,
                             double max_residual);

/// "inverse depth", "depth along the ray": for messages.
std::string text_of(const PriorReading& reading);

}  // namespace tvsgs
