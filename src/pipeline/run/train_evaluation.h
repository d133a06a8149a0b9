// Evaluates a running training on schedule, for log.jsonl.
#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "core/scene/crop.h"
#include "eval/mesh_metrics.h"
#include "io/files/json_value.h"
#include "pipeline/mesh/mesh_extraction.h"
#include "pipeline/run/view_evaluation.h"

namespace tvsgs {

/// In the configuration, so that a run can be repeated and its report rewritten.
struct EvaluationOptions {
    std::string at, gt, visible_gt, crop, taus;
    int every = 0;
    float max_distance = 0;
    std::int64_t point_samples = 0;
    bool mesh = false;

    template <class Visitor>
    void fields(Visitor& field) {
        field("at", at,
              "seconds of training at which to evaluate, such as 5,10,20; a final '...' repeats "
              "the last ratio; empty: none");
        field("every", every, {0, 1e9},
              "iterations between evaluations, the first after iteration 1; 0: none");
        field("gt", gt,
              "true surface, mesh or cloud (PLY), in the frame of the scene; empty: none");
        field("visible_gt", visible_gt,
              "part of the true surface that the views see, for completeness and recall; empty: "
              "all of it");
        field("crop", crop,
              "selection volume, {\"box\": ...} or gt/info.json of a scene; empty: none");
        field("taus", taus,
              "thresholds T,T,... of precision, recall and F1, world units; empty: 0.5, 1 and 2 % "
              "of the size of the truth");
        field("max_distance", max_distance, {0, 1e9}, "cap of distances, world units; 0: none");
        field("point_samples", point_samples, {0, 1e8},
              "points on each mesh to measure distances to, biased; 0: distances to its triangles");
        field("mesh", mesh, "measure the mesh, too; extracts it at every evaluation");
    }
};

/// Selects the steps to evaluate; `due` must be called after each candidate step.
class EvaluationSchedule {
public:
    /// `seconds`: training time before the run was resumed. Throws Error(ExitCode::usage).
    explicit EvaluationSchedule(const EvaluationOptions& options, double seconds = 0);

    /// Call at the end of `step`, after `seconds` of training.
    bool due(int step, double seconds);

private:
    std::vector<double> at_;  // times not yet reached, increasing
    double ratio_ = 0;        // factor that continues at_; 0: at_ ends
    int every_;
};

/// The true surface, prepared for measurements.
struct Truth {
    MeasureOptions measure;
    MeasuredSurface surface;
    std::optional<SamplePoints> visible;
    Crop crop;
    std::vector<double> taus;
    double max_distance = 0;
};

/// Empty without eval.gt. Throws Error.
std::optional<Truth> read_truth(const EvaluationOptions& options, Vec3d origin);

/// Distances of the splats' centres, or of the mesh, as written by `tvsgs-eval geometry`; only
/// "error" when nothing lies in the crop. With a curve: precision and recall at 41 thresholds up to
/// twice the largest tau, under "curve".
struct PointScores {
    JsonValue json;
    double chamfer = 0, f1 = 0, tau = 0;  // at the middle tau
};
PointScores score_points(const std::vector<Vec3f>& points, const Truth& truth, bool curve);
PointScores score_mesh(const TriangleMesh& mesh, const Truth& truth, bool curve);

/// Writes the scores with their curve to RUN/eval/`what`.json, and adds them to the last line of
/// the log. `what`: "centres" or "mesh".
void add_scores(JsonValue& line,
                const char* what,
                const PointScores& scores,
                const std::string& run);

/// Inputs of a mesh evaluation besides the splats.
struct MeshSource {
    const std::vector<View>& views;
    const MeshOptions& options;
    std::string spill_folder;
    Vec3d origin{};  // see depth_rules()
};

/// A run whose final score is worse than its best by more than this has trained too long.
inline constexpr double kClearlyWorse = 0.5;  // dB of PSNR

/// Mean PSNR over the views. Inside of object masks if training uses them, as the outside is not
/// trained; over whole images if no mask has a pixel of the object.
inline double psnr_trained(const ViewScores& scores, const TrainOptions& options) {
    const double inside = scores.mean_masked.psnr;
    return options.loss.photometric.masks == MaskUse::object && std::isfinite(inside)
               ? inside
               : scores.mean_psnr;
}

// PSNR of views that did not train, dB. Conventions, which the report states.
inline constexpr double kGoodPsnr = 27, kFairPsnr = 20;
inline const char* psnr_level(double psnr) {
    return psnr >= kGoodPsnr ? "good" : psnr >= kFairPsnr ? "fair" : "poor";
}

/// An evaluation during training, of the splats as `drawn`: with fixed ones after them.
struct Evaluation {
    JsonValue line;   // for log.jsonl
    double psnr = 0;  // psnr_trained() of the test views
};
template <class Device>
Evaluation evaluate(int step,
                    double seconds,
                    const Gaussians<Device>& gaussians,
                    const Gaussians<Device>& drawn,
                    const std::vector<View>& views,
                    const TrainOptions& options,
                    const std::optional<Truth>& truth,
                    const MeshSource* mesh = nullptr) {
    Evaluation result;
    JsonValue& line = result.line;
    line.add("event", "evaluation").add("iteration", step).add("seconds", seconds);
    line.add("gaussians", gaussians.size());
    if (!views.empty()) {
        const auto no_pictures = [](const View&, const ImageU8&, const auto&) {};
        const ViewScores scores =
            score_views(drawn, views, options, no_pictures, {.masked = have_masks(views)});
        line.add("psnr", scores.mean_psnr).add("ssim", scores.mean_ssim);
        if (have_masks(views)) line.add("psnr_masked", scores.mean_masked.psnr);
        result.psnr = psnr_trained(scores, options);
        spdlog::info("After {:.1f} s: PSNR {:.2f} dB, SSIM {:.4f}", seconds, scores.mean_psnr,
                     scores.mean_ssim);
    }
    if (truth) {
        const auto add = [&](const char* what, const PointScores& scores) {
            line.add(what, scores.json);
            spdlog::info("After {:.1f} s, {}: Chamfer {:.4g}, F1 {:.3f} at {:g}", seconds, what,
                         scores.chamfer, scores.f1, scores.tau);
        };
        add("centres", score_points(to_host(gaussians.means), *truth, false));
        if (mesh)
            add("mesh", score_mesh(extract_mesh(mesh->views, drawn, options, mesh->options,
                                                mesh->spill_folder, mesh->origin),
                                   *truth, false));
    }
    return result;
}

/// When training longer is no longer worthwhile.
struct Convergence {
    static constexpr double kStep = 0.02;  // dB; smaller changes are noise between views
    double best = -1e300, best_at = 0;     // best score on validation views, and its seconds
    bool over = false;  // the time since then exceeds half the time that it took to reach it

    void add(double seconds, double psnr) {
        if (psnr > best + kStep) best = psnr, best_at = seconds;
        over = best_at > 0 && seconds > 1.5 * best_at;
    }
};

/// Tracks the scores of a training: when to evaluate, the best score, and convergence.
class ScoreWatch {
public:
    /// Evaluates as `options` say and, for `until_converged`, often enough to detect convergence.
    /// `seconds`: training time before the run was resumed.
    ScoreWatch(const EvaluationOptions& options, bool until_converged, double seconds)
        : schedule_(options, seconds), validations_(validation(until_converged), seconds) {}

    /// Call at the end of `step`, after `seconds` of training.
    bool due(int step, double seconds) {
        step_ = step, seconds_ = seconds;
        validates_ = validations_.due(step, seconds);
        return schedule_.due(step, seconds) || validates_;
    }

    /// Adds the score on validation views at the last step that was due.
    void add(double psnr) {
        if (psnr > best_psnr_) best_psnr_ = psnr, best_step_ = step_;
        if (validates_) convergence_.add(seconds_, psnr);
    }

    double best_psnr() const { return best_psnr_; }  // 0: no score yet
    int best_step() const { return best_step_; }
    const Convergence& convergence() const { return convergence_; }

private:
    static EvaluationOptions validation(bool until_converged) {
        EvaluationOptions options;
        if (until_converged) options.at = "1,1.2,...";
        return options;
    }

    EvaluationSchedule schedule_, validations_;  // scheduled by the user; for convergence
    Convergence convergence_;
    double best_psnr_ = 0;
    int best_step_ = 0;
    // Results of the last due():
    int step_ = 0;
    double seconds_ = 0;
    bool validates_ = false;
};

}  // namespace tvsgs
