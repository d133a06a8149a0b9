// Reads the files of the DTU evaluation, and prepares a prediction for it.
#pragma once

#include <string>

#include "eval/benchmark_files.h"
#include "io/scene/scene_layout.h"

namespace tvsgs {

/// Reads the truth of a scan from the folder of the evaluation set. Throws Error(ExitCode::input),
/// which names missing files and where the benchmark distributes them.
DtuTruth read_dtu_truth(const std::string& folder, int scan);

/// Returns `cameras` if given; else cameras.npz (read by the published evaluations) or
/// cameras_sphere.npz in the folder of `masks` or beside it; empty without masks. Throws
/// Error(ExitCode::input) where neither file exists.
std::string find_dtu_cameras(const std::string& cameras, const std::string& masks);

struct DtuCulling {
    std::string masks;          // folder; its sorted files belong to the cameras in order
    std::string views = "all";  // whose masks are used: all, first:N, none or a list
    int dilate_px = 24;
};

/// Removes vertices outside of the masks; returns their number.
std::size_t cull_dtu(PreciseMesh& mesh, const NpzCameras& cameras, const DtuCulling& culling);

/// Converts to millimetres; returns whether the prediction was normalised. `units`: auto, mm or
/// normalised; `cameras` may be null.
bool to_millimetres(PreciseMesh& mesh, const NpzCameras* cameras, const std::string& units);

}  // namespace tvsgs
