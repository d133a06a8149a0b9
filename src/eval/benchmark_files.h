// Reads predictions and truths, and writes error clouds, for the benchmark evaluations.
#pragma once

#include <string>
#include <vector>

#include "core/math/vec.h"
#include "eval/dtu_protocol.h"
#include "eval/error_colors.h"
#include "eval/mask_cull.h"

namespace tvsgs {

/// A mesh, a cloud, or the centres of splats; vertices that are not finite are removed.
struct Prediction {
    PreciseMesh mesh;
    bool is_splats = false;
    std::size_t vertices = 0, faces = 0, dropped = 0, transparent = 0;  // as read; removed
};

/// Drops splats fainter than `min_opacity`. Throws Error(ExitCode::input) when nothing remains.
Prediction read_prediction(const std::string& path, double min_opacity);

/// Returns the finite points of a ground-truth file. `missing`: message if the file does not exist,
/// with the expected file and where the benchmark distributes it.
std::vector<Vec3d> read_truth(const std::string& path, const std::string& missing);

/// Throws Error(ExitCode::input) with `missing` unless the file exists.
void require_file(const std::string& path, const std::string& missing);

/// Parses a name of --palette; returns `standard` for an empty name.
ErrorPalette find_palette(const std::string& name, ErrorPalette standard);

/// Writes points coloured by their errors; `full` is the end of the colour scale.
void write_error_cloud(const std::string& path,
                       const MeasuredPoints& points,
                       ErrorPalette palette,
                       double full);

}  // namespace tvsgs
