// COLMAP's part: features, matches, poses and points, as Debian's colmap 3.8 does it on the CPU.
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
    std::string lens = "auto";  // a camera model of COLMAP
    std::string matcher;        // exhaustive or sequential
    std::string poses;          // folder of a model whose poses are kept; may be empty
    std::map<std::string, std::string> renamed;  // photographs that `poses` may know by other names
    std::optional<Calibration> calibration;
    int max_size = 3200, threads = 0;
};

struct Reconstruction {
    std::vector<SparseModel> models;      // of what hangs together, largest first; one at least
    std::map<std::string, int> features;  // by photograph
};

/// The file of COLMAP. Throws Error(ExitCode::usage) that names the package.
std::string find_colmap();

/// Works in `work`, on photographs in `images` by their names, and adds what COLMAP says to `log`.
/// Throws Error(ExitCode::input) where no two photographs hang together, and where COLMAP fails.
Reconstruction reconstruct(const std::string& colmap,
                           const std::filesystem::path& work,
                           const std::filesystem::path& images,
                           const std::string& log,
                           const std::vector<CameraGroup>& groups,
                           const ReconstructOptions& options);

}  // namespace tvsgs::prepare
