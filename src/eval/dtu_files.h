// What the DTU evaluation reads, and what it does to a prediction before it measures.
#pragma once

#include <string>

#include "eval/dtu_protocol.h"
#include "eval/mask_cull.h"
#include "io/scene/npz_cameras.h"

namespace tvsgs {

/// The truth of a scan from the folder of the evaluation set. Throws Error(ExitCode::input) with
/// what is missing and where the benchmark distributes it.
DtuTruth read_dtu_truth(const std::string& folder, int scan);

/// `cameras` if given; else cameras.npz, as the published evaluations read, or cameras_sphere.npz
/// beside the masks; empty without masks.
std::string find_dtu_cameras(const std::string& cameras, const std::string& masks);

struct DtuCulling {
    std::string masks;          // folder; its sorted files belong to the cameras in order
    std::string views = "all";  // whose masks cull: all, first:N, none or a list
    int dilate_px = 24;
};

/// Culls by masks; returns how many vertices went.
std::size_t cull_dtu(PreciseMesh& mesh, const NpzCameras& cameras, const DtuCulling& culling);

/// To millimetres; says whether the prediction was normalised. `units`: auto, mm or normalised;
/// `cameras` may be null.
bool to_millimetres(PreciseMesh& mesh, const NpzCameras* cameras, const std::string& units);

}  // namespace tvsgs
