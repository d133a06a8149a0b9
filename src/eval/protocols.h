// The evaluation protocols of two benchmarks, in double precision: DTU, in millimetres [Jensen14;
// DTUeval], and Tanks and Temples [Knapitsch17].
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "eval/points.h"

namespace tvsgs {

/// The volume of a scan that was observed.
struct ObservationMask {
    int nx = 0, ny = 0, nz = 0;
    std::vector<std::uint8_t> seen;  // [nz, ny, nx], x fastest; 0: not observed
    Vec3d lower, upper;              // BB, mm; rounded to float as in the official code
    double voxel = 1;                // Res, mm
};

/// The truth of a scan.
struct DtuTruth {
    Points points;
    std::optional<ObservationMask> mask;         // absent: everything counts as observed
    std::optional<std::array<double, 4>> plane;  // points above: a x + b y + c z + d > 0
};

struct DtuOptions {
    double spacing = 0.2;      // mm: of the samples and of the thinning
    double max_distance = 20;  // mm: distances from here on are outliers, excluded from the means
    double patch = 60;         // mm: margin around the box of the mask, twice that at its upper end
    std::optional<std::uint64_t> seed = 0;  // of the order of thinning; absent: the given order
    std::int64_t max_samples = 100'000'000;
};

/// All vertices, and a lattice of spacing about `spacing` inside each face with area. Throws
/// Error(ExitCode::input), E_DTU_SAMPLES, for more than max_samples points.
Points sample_dtu(const Points& vertices,
                  const std::vector<Vec3i>& faces,
                  const DtuOptions& options);

/// Use of a point in the evaluation.
enum class PointStatus : std::uint8_t { measured, outlier, excluded };

/// Points with their distances, which are NaN where excluded.
struct MeasuredPoints {
    Points points;
    std::vector<double> distances;
    std::vector<PointStatus> statuses;
};

struct DtuMetrics {
    double accuracy = 0, completeness = 0, overall = 0;  // means, mm; NaN where undefined
    double accuracy_median = 0, completeness_median = 0;
    std::int64_t sampled = 0, thinned = 0, in_box = 0, observed = 0;
    std::int64_t truth = 0, truth_above = 0, accuracy_outliers = 0, completeness_outliers = 0;
    std::string undefined;                 // the step that left no points; empty: none
    MeasuredPoints prediction, reference;  // thinned prediction; truth
};

/// Thins `samples` and measures them.
DtuMetrics evaluate_dtu(const Points& samples, const DtuTruth& truth, const DtuOptions& options);

/// Refines in three stages of ICP, each from the last result: crops both clouds and thins them to
/// voxels of tau, tau / 2, and then to every k-th point (at most about 4 million); partners within
/// 80, 20 and 2 tau. `intended`: uses the 20 iterations that the official script specifies but does
/// not get.
struct IcpRefinement {
    Affine3d truth_from_prediction;
    std::vector<IcpResult> stages;
};
IcpRefinement refine_by_icp(const Points& prediction,
                            const Points& truth_cropped,
                            const Crop& crop,
                            const Affine3d& start,
                            double tau,
                            bool intended);

struct TntMetrics {
    double precision = 0, recall = 0, f1 = 0;  // fractions strictly closer than tau
    std::int64_t prediction_cropped = 0, truth_cropped = 0;
    MeasuredPoints prediction, truth;  // one mean per voxel
    std::string undefined;             // the cloud that the crop left empty; empty: none
    // Cumulative shares of points at or below edges[i + 1], as in the official plots.
    std::vector<double> edges, precision_curve, recall_curve;
};

/// Crops both clouds (in the frame of the truth), takes the mean per voxel (voxel 0: all points)
/// and compares them.
TntMetrics evaluate_tnt(
    const Points& prediction, const Points& truth, const Crop& crop, double tau, double voxel);

}  // namespace tvsgs
