// Points to measure from, and distances as JSON: what `tvsgs-eval geometry` and the evaluations
// during training share.
#pragma once

#include <string>
#include <vector>

#include "core/scene/crop.h"
#include "eval/mesh_metrics.h"
#include "io/files/json_value.h"

namespace tvsgs {

/// Of a share of the samples of a mesh; more samples than this asks for are not drawn.
inline constexpr double kStandardError = 1e-3;

struct MeasureOptions {
    std::int64_t point_samples = 0;  // 0: meshes are their triangles; else so many even samples
    std::uint64_t seed = 0;
    std::string crop_path;  // for messages
    Vec3d origin{};         // of the frame of the result; that of files and crop is at zero
};

/// Those of the truth: other lines than the prediction's, so that their errors are independent.
MeasureOptions of_truth(MeasureOptions options);

/// What distances to a mesh are measured to, and from in the crop. Throws Error(ExitCode::input)
/// for a mesh without a surface in the crop.
MeasuredSurface measured_mesh(const TriangleMesh& mesh,
                              const MeasureOptions& options,
                              const Crop& crop);

/// The same for points; those in the crop are measured from, and all to.
MeasuredSurface measured_points(const std::vector<Vec3f>& points,
                                const MeasureOptions& options,
                                const Crop& crop);

/// A mesh, a cloud, or the centres of splats; says and counts what is not finite. Throws
/// Error(ExitCode::input), with the path, when nothing is in the crop.
MeasuredSurface read_measured(const std::string& path,
                              const MeasureOptions& options,
                              const Crop& crop);

/// Accuracy, completeness, Chamfer, their medians, the list "thresholds", and standard errors of
/// what was sampled.
JsonValue geometry_json(const GeometryMetrics& metrics);

/// {"pred", "gt", "visible_gt"}: how many points distances were measured from; `visible` may be
/// null.
JsonValue counts_json(const MeasuredSurface& prediction,
                      const MeasuredSurface& truth,
                      const SamplePoints* visible);

}  // namespace tvsgs
