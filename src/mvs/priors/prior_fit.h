// Scale and shift of a prior depth map, and what its numbers are, from points of known depth.
// [docs/guide/priors.md#how-scale-and-shift-are-found]
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "core/scene/prior_conventions.h"

namespace tvsgs {

/// A point that a view sees, and what the map has there.
struct PriorSample {
    double value;     // of the map, finite
    double depth;     // z, > 0
    double distance;  // along the ray
};
using PriorSamples = std::vector<PriorSample>;

/// What a map's numbers are taken for.
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
    /// The same of one depth for all points, their median: what a map that knows nothing has.
    double residual_of_constant = std::numeric_limits<double>::infinity();
};

/// Does the map leave open most of what one depth for all points does? Maps of other photographs of
/// the scene left 0.6 to 2.5 times as much, with noise of 5 % the right ones 0.6 at most. Below a
/// hundredth that asks for more than points can tell.
inline bool tells_nothing(const PriorFit& fit) {
    return fit.found && fit.residual > 0.01 && fit.residual > 0.65 * fit.residual_of_constant;
}

/// Fewest points that a fit is made of.
inline constexpr std::size_t kFewestForScale = 6, kFewestForShift = 12;

/// A fit that up to nearly half of the points may contradict (points that the surface hides): the
/// best in the median of one by medians and of 100 through two points each, then reweighted least
/// squares (Huber), all in double, about the mean. Where the values are nearly alike (a standard
/// deviation of a thousandth), nothing tells scale from shift, and the unit alone is found. Not
/// found: too few points, or a scale that is not positive.
PriorFit fit_prior(const PriorSamples& samples, const PriorReading& reading);

/// z of a value; `cosine` of the angle between ray and axis. 0 where there is none.
double prior_depth(double value, const PriorFit& fit, const PriorReading& reading, double cosine);

/// Spearman's: 1 where the values grow with depth, -1 where they fall. 0 of less than 3 samples.
double rank_correlation(const PriorSamples& samples);

/// What all views agree on.
struct ReadingChoice {
    PriorReading reading;
    double residual = std::numeric_limits<double>::infinity();  // median over views
    int tested_views = 0;
};

/// The reading of the files that the points bear out. What `convention` leaves open is tried; what
/// it takes for usual gives way to a reading that most views fit clearly better, as depth always
/// does to inverse depth where numbers fall with depth. Throws Error(ExitCode::input), E_PRIORS:
/// where something else than what is declared fits clearly better, where no reading fits within
/// `max_residual`, or where the numbers run against depth. Without enough points in any view
/// nothing is tested, and the usual reading stands.
ReadingChoice choose_reading(const std::vector<PriorSamples>& views,
                             const DepthConvention& convention,
                             double max_residual);

/// "inverse depth", "depth along the ray": for messages.
std::string text_of(const PriorReading& reading);

}  // namespace tvsgs
