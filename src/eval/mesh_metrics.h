// Geometric errors of a reconstruction against the truth: samples of a surface, independent of its
// triangulation, distances of points to a surface, and their scores as JSON, for `tvsgs-eval
// geometry` and the evaluations during training.  [DTU, Jensen14; Tanks and Temples, Knapitsch17]
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "core/scene/crop.h"
#include "core/scene/mesh.h"
#include "eval/points.h"
#include "io/files/json_value.h"
#include "mesh/mend/triangle_tree.h"

namespace tvsgs {

/// Points that distances are measured from.
struct SamplePoints {
    Points points;
    /// First point of each draw; the points of one draw depend on each other. Empty: `points` is no
    /// sample but the whole set.
    std::vector<std::uint32_t> draws;
    double area = 0;  // estimated area of the sampled surface; 0: not sampled
};

/// The largest standard error that a share of the points can have, for the numbers of points per
/// draw: at most 1 / (2 sqrt(n)) for n draws of one point. 0 for points that are not a sample.
double worst_standard_error(const SamplePoints& sample);

/// Samples the surface inside the crop uniformly by area: intersects it with lines that are uniform
/// among all lines through a box around it.  [Santalo76, Cauchy-Crofton] The points depend on the
/// surface and not on its triangles. Draws lines until the worst standard error of a share is
/// `standard_error`, at most 10^8. `origin`: of the mesh's frame in the crop's frame. Returns no
/// points where no surface lies inside.
SamplePoints sample_by_lines(const TriangleTree& tree,
                             const Crop& crop,
                             Vec3d origin,
                             double standard_error,
                             std::uint64_t seed);

/// A surface that distances are measured to: triangles of a mesh (exact), or points of a cloud.
class Surface {
public:
    Surface() = default;  // empty: all distances are infinite
    /// Drops vertices and points that are not finite. Throws Error(ExitCode::input) for an index
    /// out of range.
    explicit Surface(const TriangleMesh& mesh);
    explicit Surface(const std::vector<Vec3f>& points);
    explicit Surface(const Points& points);

    /// The triangles; empty for a cloud.
    const TriangleTree& triangles() const { return triangles_; }

    /// Distance of each point, or infinity where it is not below `limit`.
    std::vector<double> distances(const Points& points,
                                  double limit = std::numeric_limits<double>::infinity()) const;

private:
    struct Cloud;
    TriangleTree triangles_;
    std::shared_ptr<const Cloud> cloud_;
};

/// All of the points as SamplePoints, without sampling.
SamplePoints all_points(const std::vector<Vec3f>& points);

/// Distance of each point to the nearest of `targets` (not empty).
std::vector<double> nearest_distances(const Points& points, const Points& targets);

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

/// Target standard error of a share of a mesh's samples; determines the number of samples.
inline constexpr double kStandardError = 1e-3;

struct MeasureOptions {
    std::int64_t point_samples = 0;  // 0: measure to triangles; else to this many even samples
    std::uint64_t seed = 0;
    std::string crop_path;  // for messages
    Vec3d origin{};         // origin of the result's frame; files and crop have theirs at zero
    bool truth = false;     // see of_truth()
};

/// Options for the truth: it uses other sampling lines, so that its error is independent.
MeasureOptions of_truth(MeasureOptions options);

/// Prepares a mesh: samples in the crop, and a surface to measure distances to. Throws
/// Error(ExitCode::input) for a mesh without a surface in the crop.
MeasuredSurface measured_mesh(const TriangleMesh& mesh,
                              const MeasureOptions& options,
                              const Crop& crop);

/// Prepares points: distances are measured from the points in the crop, and to all points.
MeasuredSurface measured_points(const std::vector<Vec3f>& points,
                                const MeasureOptions& options,
                                const Crop& crop);

/// Reads a mesh, a cloud, or the centres of splats; counts and logs values that are not finite.
/// Throws Error(ExitCode::input), with the path, when the crop is empty.
MeasuredSurface read_measured(const std::string& path,
                              const MeasureOptions& options,
                              const Crop& crop);

/// Accuracy, completeness, Chamfer distance, their medians, the list "thresholds", and standard
/// errors of sampled values.
JsonValue geometry_json(const GeometryMetrics& metrics);

/// {"pred", "gt", "visible_gt"}: numbers of points that distances were measured from. `visible` may
/// be null.
JsonValue counts_json(const MeasuredSurface& prediction,
                      const MeasuredSurface& truth,
                      const SamplePoints* visible);

}  // namespace tvsgs
