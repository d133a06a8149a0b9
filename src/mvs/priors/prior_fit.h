// Fits scale and shift of prior depth maps to points of known depth; detects the convention of the
// maps and the frame of prior normals.
// [docs/guide/priors.md#how-scale-and-shift-are-found, docs/guide/priors.md#normals]
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "core/scene/camera.h"
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
    /// Residual of the best constant depth, which is the points' median; a map without information
    /// reaches this residual.
    double residual_of_constant = std::numeric_limits<double>::infinity();
};

/// True if the map explains too little: its residual is more than 0.65 of a constant depth's. Maps
/// of other photographs of the scene had 0.6 to 2.5 of that residual, the right maps at most 0.6
/// even with 5 % noise. Points cannot judge residuals below 0.01.
inline bool is_uninformative(const PriorFit& fit) {
    return fit.found && fit.residual > 0.01 && fit.residual > 0.65 * fit.residual_of_constant;
}

/// Fewest points for a fit.
inline constexpr std::size_t kFewestForScale = 6, kFewestForShift = 12;

/// Robust fit: up to nearly half of the points may be wrong, for example hidden by the surface. It
/// makes one fit by medians and 100 fits through two points each, starts from the one with the
/// least median error, and runs reweighted least squares (Huber) about the mean, in double. If the
/// values are almost equal (relative standard deviation of a thousandth), it cannot separate scale
/// and shift and finds only the scale, or the shift for log depth. It finds no fit for too few
/// points, or if the scale is not positive.
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

/// Chooses the reading that fits the points. Tries all values that `convention` leaves open. An
/// assumed value gives way to a value that fits most views clearly better. For alignment rank it
/// tests only the order: assumed depth gives way to inverse depth if the numbers fall with depth.
/// Without enough points in any view it returns the assumed reading untested. Throws
/// Error(ExitCode::input), E_PRIORS, if a reading fits clearly better than the declared one, if no
/// reading fits within `max_residual`, or if the numbers have the wrong order.
ReadingChoice choose_reading(const std::vector<PriorSamples>& views,
                             const DepthConvention& convention,
                             double max_residual);

/// Name for messages, such as "inverse depth" or "depth along the ray".
std::string text_of(const PriorReading& reading);

/// Unit normals of a cloud, of either sign: each is the normal of the plane through the 12 nearest
/// points; 0 if these do not lie in a plane.
std::vector<Vec3f> cloud_normals(const std::vector<Vec3f>& points);

/// The map's normal at a point and the normal of the surrounding points: unit, in the camera's
/// frame, facing the camera.
struct NormalSample {
    Vec3d found;  // as in the file
    Vec3d
        found_world;  // camera_from_world.R * found: in the camera's frame if the file is in world
    Vec3d expected;
};

/// camera = signs * (world ? R : 1) * found, element by element.
struct NormalReading {
    bool world = false;
    Vec3f signs{1, 1, 1};
};
/// The reading that a convention describes, and its name for messages.
NormalReading reading_of(const NormalConvention& convention);
std::string text_of(const NormalReading& reading);

/// The chosen reading with its agreement.
struct NormalChoice {
    NormalReading reading;
    double cosine = 0;  // mean over the samples; 0: not tested
    std::size_t samples = 0;
};

/// Agreement of normals with the points of a view, and of the best single normal.
struct PriorAgreement {
    double cosine = 1, cosine_of_constant = 0;  // means over the samples
};
/// Returns 1 and 0 for fewer than 50 samples, which are too few to judge.
PriorAgreement agreement_of(const std::vector<NormalSample>& samples, const NormalReading& reading);

/// True if the map's error (1 - cosine) is more than half of the best single normal's. Errors up to
/// 0.15 (32 degrees) may come from the points: right maps had up to 24 degrees.
inline bool is_uninformative(const PriorAgreement& a) {
    return 1 - a.cosine > 0.15 && 1 - a.cosine > 0.5 * (1 - a.cosine_of_constant);
}

/// Chooses the reading that fits the points. It tries both signs of each axis of the camera's
/// frame, and world normals of either sign. A reading replaces `convention` if its mean cosine is
/// larger by 0.2. Below 50 samples nothing is tested. Throws Error(ExitCode::input), E_PRIORS, if
/// `convention` is declared and would be replaced, or if no cosine exceeds 0.3.
NormalChoice choose_normals(const std::vector<NormalSample>& samples,
                            const NormalConvention& convention);

}  // namespace tvsgs
