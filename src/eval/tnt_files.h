// What the evaluation of Tanks and Temples reads, and how it brings a prediction into the truth's
// frame.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/math/affine.h"
#include "core/scene/crop.h"
#include "eval/benchmark_files.h"
#include "io/files/json_value.h"

namespace tvsgs {

/// Where the benchmark distributes its files.
extern const char* const kTntDistribution;

/// The files of one scene.
struct TntFiles {
    std::string scene, cloud, crop, log, trans;
};

/// The scene that `scene_name` or the folder names, or the one whose log the folder holds.
TntFiles find_tnt_files(const std::string& scene_dir, const std::string& scene_name);

/// The threshold of a scene unless one is `given` (above 0).
double find_tnt_tau(double given, const std::string& scene);

struct TntAlignment {
    Affine3d start, final;
    std::string how;
    JsonValue json;
};

/// Where the prediction lies in the frame of the truth, by cameras: those of `trajectory`, or of
/// the official log if that is empty. Throws Error(ExitCode::input) where few agree, unless
/// `force`.
void align_by_cameras(const std::string& trajectory,
                      const TntFiles& files,
                      double threshold,
                      std::uint64_t seed,
                      bool force,
                      TntAlignment& out);

/// ICP, and how far it moved the prediction.
void refine_tnt(const std::vector<Vec3d>& points,
                const std::vector<Vec3d>& truth_cropped,
                const Crop& crop,
                double tau,
                bool intended,
                TntAlignment& out);

/// The points of the prediction that count. `choice`: auto, vertices, vertices+centroids or area:N;
/// `used` becomes what it stood for.
std::vector<Vec3d> choose_tnt_points(const Prediction& in,
                                     const std::string& choice,
                                     std::uint64_t seed,
                                     std::string& used);

/// Throws Error(ExitCode::input) unless the aligned points lie where the truth does. `name`: of the
/// prediction, for the message.
void check_tnt_overlap(const std::vector<Vec3d>& moved,
                       const std::vector<Vec3d>& truth_cropped,
                       const Crop& crop,
                       const std::string& name);

}  // namespace tvsgs
