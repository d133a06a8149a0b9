// How far a reconstruction is from the truth.  [DTU, Jensen14; Tanks and Temples, Knapitsch17]
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/mesh.h"
#include "eval/surface.h"

namespace tvsgs {

/// Points spread evenly over the area of a mesh, in the order of its faces: the i-th of `count`
/// equal shares of the area gets one, at a place drawn with `seed`. Faces without area or with
/// non-finite corners get none. Throws Error(ExitCode::input) when no face is left or an index is
/// out of range.
std::vector<Vec3f> sample_surface(const TriangleMesh& mesh,
                                  std::size_t count,
                                  std::uint64_t seed = 0);

/// Of an even number of values (at least one) the mean of the middle two.
double median_of(std::vector<double> values);

struct GeometryOptions {
    std::vector<double> taus;  // thresholds, in the units of the truth
    double max_distance = 0;   // distances are capped there; 0: not
};

/// Standard errors are those of drawing the points that distances are measured from; 0 where these
/// were not drawn.
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

/// A prediction or a truth: where it is measured from, in the crop, and to.
struct MeasuredSurface {
    SamplePoints from;
    Surface to;
    std::size_t dropped = 0;  // points of its file that are not finite
};

/// `wanted_truth`: what completeness and recall are measured from where that is not all of the
/// truth, as the part that cameras see; null: all. Throws Error(ExitCode::input) when prediction or
/// truth have no points.
GeometryMetrics evaluate_geometry(const MeasuredSurface& prediction,
                                  const MeasuredSurface& truth,
                                  const SamplePoints* wanted_truth,
                                  const GeometryOptions& options);

}  // namespace tvsgs
