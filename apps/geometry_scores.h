// Points to measure from, and distances as JSON: what `tvsgs-eval geometry` and the evaluations
// during training share.
#pragma once

#include <string>
#include <vector>

#include "core/crop.h"
#include "io/config.h"
#include "mesh/mesh_metrics.h"

namespace tvsgs {

struct PointsOptions {
    std::int64_t samples = 1000000;  // of a mesh
    std::uint64_t seed = 0;
    std::string crop_path;  // for messages
    Vec3d origin{};         // of the frame of the result; that of files and crop is at zero
};

/// Even samples of a mesh, the points of a cloud, the centres of splats; those in the crop. Throws
/// Error(ExitCode::input) when none is left.
std::vector<Vec3f> read_points(const std::string& path,
                               const PointsOptions& options,
                               const Crop& crop);

/// A JSON list of objects.
std::string json_list(const std::vector<JsonLine>& items);

/// Accuracy, completeness, Chamfer, their medians, and the list "thresholds".
JsonLine geometry_json(const GeometryMetrics& metrics);

}  // namespace tvsgs
