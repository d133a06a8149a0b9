// What the benchmark evaluations read and write alike.
#pragma once

#include <string>
#include <vector>

#include "core/math/vec.h"
#include "eval/dtu_protocol.h"
#include "eval/error_colors.h"
#include "eval/mask_cull.h"

namespace tvsgs {

/// A mesh, cloud or splats (their centres), without vertices that are not finite.
struct Prediction {
    PreciseMesh mesh;
    bool is_splats = false;
    std::size_t vertices = 0, faces = 0, dropped = 0, transparent = 0;  // as read; removed
};

/// Splats fainter than `min_opacity` are left out. Throws Error(ExitCode::input) when nothing is
/// left.
Prediction read_prediction(const std::string& path, double min_opacity);

/// The finite points of a ground-truth file. `missing` says, where there is no such file, what was
/// looked for and where the benchmark distributes it.
std::vector<Vec3d> read_truth(const std::string& path, const std::string& missing);

/// Throws Error(ExitCode::input) with `missing` unless the file exists.
void require_file(const std::string& path, const std::string& missing);

/// Names as --palette takes them; `standard` for an empty name.
ErrorPalette find_palette(const std::string& name, ErrorPalette standard);

/// Points coloured by their errors; `full` is where the scale ends.
void write_error_cloud(const std::string& path,
                       const MeasuredPoints& points,
                       ErrorPalette palette,
                       double full);

}  // namespace tvsgs
