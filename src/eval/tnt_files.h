// Reads and writes the files of the Tanks and Temples evaluation, and aligns a prediction with the
// truth.
#pragma once

#include <string>
#include <vector>

#include "eval/benchmark_files.h"
#include "eval/tnt_protocol.h"
#include "io/files/json_value.h"

namespace tvsgs {

/// Where the benchmark distributes its files.
extern const char* const kTntDistribution;

/// The files of one scene.
struct TntFiles {
    std::string scene, cloud, crop, log, trans;
};

/// Finds the scene by `scene_name`, by the folder's name, or by the log file in the folder.
TntFiles find_tnt_files(const std::string& scene_dir, const std::string& scene_name);

/// Returns `given` if it is above 0, else the threshold of the scene.
double find_tnt_tau(double given, const std::string& scene);

struct TntAlignment {
    Affine3d start, final;
    std::string how;
    JsonValue json;
};

/// Aligns the prediction with the truth by camera centres, from `trajectory` or, if empty, the
/// official log. Throws Error(ExitCode::input) where too few centres agree, unless `force`.
void align_by_cameras(const std::string& trajectory,
                      const TntFiles& files,
                      double threshold,
                      std::uint64_t seed,
                      bool force,
                      TntAlignment& out);

/// Refines the alignment by ICP, and measures how far that moved the prediction.
void refine_tnt(const Points& points,
                const Points& truth_cropped,
                const Crop& crop,
                double tau,
                bool intended,
                TntAlignment& out);

/// Selects the points to evaluate. `choice`: auto, vertices, vertices+centroids or area:N; sets
/// `used` to the resolved choice.
Points choose_tnt_points(const Prediction& in,
                         const std::string& choice,
                         std::uint64_t seed,
                         std::string& used);

/// Throws Error(ExitCode::input) unless the aligned points overlap the truth. `name`: of the
/// prediction, for the message.
void check_tnt_overlap(const Points& moved,
                       const Points& truth_cropped,
                       const Crop& crop,
                       const std::string& name);

/// Writes FOLDER/<scene>.precision.txt, .recall.txt, .prf_tau_plotstr.txt and
/// PR_<scene>_@d_th_0_*.svg.
void write_curves(const std::string& folder,
                  const std::string& scene,
                  const TntMetrics& metrics,
                  double tau);

}  // namespace tvsgs
