// How far a reconstruction is from the truth.  [DTU, Jensen14; Tanks and Temples, Knapitsch17]
#pragma once

#include <cstdint>
#include <vector>

#include "core/mesh.h"

namespace tvsgs {

/// Points spread evenly over the area of a mesh, in the order of its faces: the i-th of `count`
/// equal shares of the area gets one, at a place drawn with `seed`. Faces without area or with
/// non-finite corners get none. Throws Error(ExitCode::input) when no face is left or an index is
/// out of range.
std::vector<Vec3f> sample_surface(const TriangleMesh& mesh,
                                  std::size_t count,
                                  std::uint64_t seed = 0);

/// Distance of each point to the nearest of `targets` (not empty).
std::vector<double> nearest_distances(const std::vector<Vec3f>& points,
                                      const std::vector<Vec3f>& targets);
std::vector<double> nearest_distances(const std::vector<Vec3d>& points,
                                      const std::vector<Vec3d>& targets);

/// Of an even number of values (at least one) the mean of the middle two.
double median_of(std::vector<double> values);

struct GeometryOptions {
    std::vector<double> taus;  // thresholds, in the units of the truth
    double max_distance = 0;   // distances are capped there; 0: not
};

struct GeometryMetrics {
    struct Threshold {
        double tau, precision, recall, f1;  // fractions of points strictly closer than tau
    };
    double accuracy, completeness, chamfer;  // prediction to truth, truth to prediction, their mean
    double median_accuracy, median_completeness;
    std::vector<Threshold> thresholds;
};

/// `visible_truth`: the truth that completeness and recall ask for, where it is not all of `truth`;
/// may be empty. Throws Error(ExitCode::input) when prediction or truth have no points.
GeometryMetrics evaluate_geometry(const std::vector<Vec3f>& prediction,
                                  const std::vector<Vec3f>& truth,
                                  const std::vector<Vec3f>& visible_truth,
                                  const GeometryOptions& options);

}  // namespace tvsgs
