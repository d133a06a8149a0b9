// Geometric errors of a reconstruction against the truth.  [DTU, Jensen14; Tanks and Temples,
// Knapitsch17]
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/mesh.h"
#include "eval/surface.h"

namespace tvsgs {

/// Samples points evenly over the area of a mesh, in the order of its faces: splits the area into
/// `count` equal shares and draws a point in each with `seed`. Skips faces without area or with
/// corners that are not finite. Throws Error(ExitCode::input) when no face remains or an index is
/// out of range.
std::vector<Vec3f> sample_surface(const TriangleMesh& mesh,
                                  std::size_t count,
                                  std::uint64_t seed = 0);

/// Median of at least one value; for an even count the mean of the middle two.
double median_of(std::vector<double> values);

struct GeometryOptions {
    std::vector<double> taus;  // thresholds, in units of the truth
    double max_distance = 0;   // distances are capped at this; 0: no cap
};

/// Standard errors come from sampling the points that distances are measured from; 0 where points
/// were not sampled.
struct GeometryMetrics {
    struct Threshold {
        double tau, precision, recall, f1;  // fractions of points strictly closer than tau
        double precision_se = 0, recall_se = 0, f1_se = 0;
    };
    double accuracy, completeness, chamfer;  // prediction to truth, truth to prediction, their mean
    double median_accuracy, median_completeness;
    double accuracy_se = 0, completeness_se = 0;
    std::vector<Threshold> thresholds;
};

/// A prediction or a truth: points (in the crop) that distances start from, and a surface to
/// measure to.
struct MeasuredSurface {
    SamplePoints from;
    Surface to;
    std::size_t dropped = 0;  // points of its file that are not finite
};

/// `wanted_truth`: the points for completeness and recall, for instance the part that cameras see;
/// null: all of the truth. Throws Error(ExitCode::input) when prediction or truth have no points.
GeometryMetrics evaluate_geometry(const MeasuredSurface& prediction,
                                  const MeasuredSurface& truth,
                                  const SamplePoints* wanted_truth,
                                  const GeometryOptions& options);

}  // namespace tvsgs
