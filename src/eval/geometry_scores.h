// Sample points of a mesh or cloud, and distances as JSON; shared by `tvsgs-eval geometry` and the
// evaluations during training.
#pragma once

#include <string>
#include <vector>

#include "core/scene/crop.h"
#include "eval/mesh_metrics.h"
#include "io/files/json_value.h"

namespace tvsgs {

/// Target standard error of a share of a mesh's samples; determines the number of samples.
inline constexpr double kStandardError = 1e-3;

struct MeasureOptions {
    std::int64_t point_samples = 0;  // 0: measure to triangles; else to this many even samples
    std::uint64_t seed = 0;
    std::string crop_path;  // for messages
    Vec3d origin{};         // origin of the result's frame; files and crop have theirs at zero
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
