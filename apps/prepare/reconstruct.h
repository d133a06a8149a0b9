// Makes a model with COLMAP on the CPU: features, matches, poses and points.
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
    // exhaustive: all pairs; sequential: neighbours by name; transitive: then also pairs that match
    // the same photograph.
    std::string matcher;
    std::string poses;                           // folder of a model with known poses; may be empty
    std::map<std::string, std::string> renamed;  // other names of photographs in `poses`
    std::optional<Calibration> calibration;
    int feature_size = 2000;  // longest side for the feature search, pixels
    int longest_side = 0;     // of the photographs, pixels
    int threads = 0;          // 0: as COLMAP chooses
};

struct Reconstruction {
    std::vector<SparseModel> models;  // connected sets of photographs, largest first; at least one
    std::map<std::string, int> features;  // by photograph
    std::string colmap;                   // its version
};

/// Works in `work` on the photographs in `images`, and appends COLMAP's output to `log`. Throws
/// Error(ExitCode::input) if no two photographs are connected, and if COLMAP fails, and
/// Error(ExitCode::usage) if it lacks an option.
Reconstruction reconstruct(const std::string& colmap,
                           const std::filesystem::path& work,
                           const std::filesystem::path& images,
                           const std::string& log,
                           const std::vector<CameraGroup>& groups,
                           const ReconstructOptions& options);

}  // namespace tvsgs::prepare
