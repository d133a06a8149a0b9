#include "pipeline/run/train_evaluation.h"

#include <algorithm>

#include "core/error.h"
#include "core/log.h"
#include "core/parse_numbers.h"
#include "io/files/atomic_file.h"
#include "io/scene/crop_file.h"

namespace tvsgs {
namespace {

constexpr int kCurvePoints = 40;

double diagonal(const std::vector<Vec3d>& points) {
    Vec3d lower = points.front(), upper = lower;
    for (const Vec3d p : points)
        for (int a = 0; a < 3; ++a)
            lower[a] = std::min(lower[a], p[a]), upper[a] = std::max(upper[a], p[a]);
    return norm(upper - lower);
}

/// `make` returns the prediction; its errors go into the scores.
template <class Make>
PointScores score(const Make& make, const Truth& truth, bool curve) {
    PointScores scores;
    scores.chamfer = scores.f1 = std::nan("");
    MeasuredSurface prediction;
    try {
        prediction = make();
    } catch (const Error& error) {
        if (error.code() != ExitCode::input) throw;
        scores.json.add("error", error.what());
        return scores;
    }
    GeometryOptions options{truth.taus, truth.max_distance};
    const double end = truth.taus.empty() ? 0 : 2 * *std::ranges::max_element(truth.taus);
    if (curve)
        for (int i = 0; i <= kCurvePoints; ++i) options.taus.push_back(end * i / kCurvePoints);
    const SamplePoints* const visible = truth.visible ? &*truth.visible : nullptr;
    GeometryMetrics metrics = evaluate_geometry(prediction, truth.surface, visible, options);
    std::vector<GeometryMetrics::Threshold> on_curve;
    if (curve) {
        const auto split = metrics.thresholds.begin() + std::ptrdiff_t(truth.taus.size());
        on_curve.assign(split, metrics.thresholds.end());
        metrics.thresholds.erase(split, metrics.thresholds.end());
    }
    scores.chamfer = metrics.chamfer;
    if (!metrics.thresholds.empty()) {
        const auto& middle = metrics.thresholds[metrics.thresholds.size() / 2];
        scores.f1 = middle.f1, scores.tau = middle.tau;
    }
    scores.json = geometry_json(metrics);
    scores.json.add("points", counts_json(prediction, truth.surface, visible));
    if (curve) {
        std::vector<double> tau, precision, recall;
        for (const auto& t : on_curve) {
            tau.push_back(rounded(t.tau, 6));
            precision.push_back(rounded(t.precision, 6)), recall.push_back(rounded(t.recall, 6));
        }
        scores.json.add(
            "curve", JsonValue().add("tau", tau).add("precision", precision).add("recall", recall));
    }
    return scores;
}

}  // namespace

EvaluationSchedule::EvaluationSchedule(const EvaluationOptions& options, double seconds)
    : every_(options.every) {
    std::string text = options.at;
    if (text.empty()) return;
    if (every_ > 0)
        throw Error(ExitCode::usage, "--eval-at ", text, " and --eval-every ", every_,
                    " exclude each other; give one (eval.at, eval.every)");
    const bool goes_on = text.ends_with(",...");
    if (goes_on) text.resize(text.size() - 4);
    at_ = parse_numbers("--eval-at", text);
    const bool increasing = std::ranges::adjacent_find(at_, std::greater_equal<>()) == at_.end();
    if (!increasing || (goes_on && at_.size() < 2))
        throw Error(ExitCode::usage, "--eval-at ", options.at,
                    ": expected increasing seconds such as 5,10,20, two or more before '...'");
    if (goes_on) ratio_ = at_.back() / at_[at_.size() - 2];
    due(0, seconds);  // skips times that have passed
}

bool EvaluationSchedule::due(int step, double seconds) {
    bool now = every_ > 0 && (step == 1 || step % every_ == 0);
    while (!at_.empty() && seconds >= at_.front()) {
        now = true;
        if (at_.size() == 1 && ratio_ > 0) at_.push_back(at_.front() * ratio_);
        at_.erase(at_.begin());
    }
    return now;
}

std::optional<Truth> read_truth(const EvaluationOptions& options, Vec3d origin) {
    if (options.gt.empty()) {
        for (const auto& [flag, value] :
             {std::pair("--crop", options.crop), std::pair("--visible-gt", options.visible_gt),
              std::pair("--tau", options.taus),
              std::pair("--eval-mesh", std::string(options.mesh ? "true" : ""))})
            if (!value.empty())
                throw Error(ExitCode::usage, flag, " ", value,
                            ": needs --gt FILE, the true surface");
        return std::nullopt;
    }
    Truth truth;
    if (!options.crop.empty()) truth.crop = read_crop(options.crop);
    truth.measure = {options.point_samples, 0, options.crop, origin};
    truth.surface = read_measured(options.gt, of_truth(truth.measure), truth.crop);
    if (!options.visible_gt.empty())
        truth.visible = read_measured(options.visible_gt, of_truth(truth.measure), truth.crop).from;
    truth.max_distance = double(options.max_distance);
    if (options.taus.empty()) {
        const double size = diagonal(truth.surface.from.points);
        for (const double share : {0.005, 0.01, 0.02})
            if (const double tau = rounded(share * size, 2); tau > 0)
                truth.taus.push_back(tau);  // two digits, to be printed and entered again
    } else {
        truth.taus = parse_numbers("--tau", options.taus);
    }
    return truth;
}

PointScores score_points(const std::vector<Vec3f>& points, const Truth& truth, bool curve) {
    return score([&] { return measured_points(points, truth.measure, truth.crop); }, truth, curve);
}

PointScores score_mesh(const TriangleMesh& mesh, const Truth& truth, bool curve) {
    return score([&] { return measured_mesh(mesh, truth.measure, truth.crop); }, truth, curve);
}

void add_scores(JsonValue& line,
                const char* what,
                const PointScores& scores,
                const std::string& run) {
    write_text_file(str(run, "/eval/", what, ".json"), json_text(scores.json) + "\n");
    line.add(what, scores.json);
    spdlog::info("{}: Chamfer {:.4g}, F1 {:.3f} at {:g}", what, scores.chamfer, scores.f1,
                 scores.tau);
}

}  // namespace tvsgs
