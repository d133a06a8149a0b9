// Runs COLMAP: features, matches, poses and points, with Debian's colmap 3.8 on the CPU.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "apps/prepare/opencv.h"
#include "apps/prepare/photographs.h"
#include "apps/prepare/sparse_model.h"

namespace tvsgs::prepare {

struct ReconstructOptions {
    std::string lens = "auto";                   // a camera model of COLMAP
    std::string matcher;                         // exhaustive or sequential
    std::string poses;                           // folder of a model with known poses; may be empty
    std::map<std::string, std::string> renamed;  // other names of photographs in `poses`
    std::optional<Calibration> calibration;
    int max_size = 3200, threads = 0;  // threads 0: as COLMAP chooses
};

struct Reconstruction {
    std::vector<SparseModel> models;  // connected sets of photographs, largest first; at least one
    std::map<std::string, int> features;  // by photograph
};

/// Path of the COLMAP program. Throws Error(ExitCode::usage) that names the package.
std::string find_colmap();

/// Works in `work` on the photographs in `images`, and appends COLMAP's output to `log`. Throws
/// Error(ExitCode::input) if no two photographs are connected, and if COLMAP fails.
Reconstruction reconstruct(const std::string& colmap,
                           const std::filesystem::path& work,
                           const std::filesystem::path& images,
                           const std::string& log,
                           const std::vector<CameraGroup>& groups,
                           const ReconstructOptions& options);

}  // namespace tvsgs::prepare
