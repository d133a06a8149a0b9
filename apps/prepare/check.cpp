#include "apps/prepare/check.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/math/quantile.h"

namespace tvsgs::prepare {
namespace {

double round_to(double value, double step) {
    return std::round(value / step) * step;
}

void measure_residuals(const SparseModel& model, Check& check) {
    std::map<std::uint64_t, Vec3d> points;
    for (const SparsePoint& point : model.points) points[point.id] = point.position;
    std::map<std::uint32_t, Intrinsics> cameras;
    for (const SparseCamera& camera : model.cameras) cameras[camera.id] = intrinsics_of(camera);
    double sum = 0;
    for (const SparseImage& image : model.images) {
        const Intrinsics& in = cameras.at(image.camera_id);
        const Rigid3d pose = image.camera_from_world();
        double own = 0;
        std::size_t count = 0;
        for (const SparseObservation& seen : image.observations) {
            const auto point = points.find(seen.point);
            if (point == points.end()) continue;
            const auto at = pixel_of(in, pose, point->second);
            if (!at) continue;
            const Vec2<double> miss = *at - seen.place;
            own += std::sqrt(dot(miss, miss));
            ++count;
        }
        sum += own;
        check.observations += count;
        if (count == 0) continue;
        const double mean = own / static_cast<double>(count);
        if (mean > check.worst_px) check.worst_px = mean, check.worst = image.name;
    }
    if (check.observations > 0) check.residual_px = sum / static_cast<double>(check.observations);
}

double median_angle_deg(const SparseModel& model) {
    std::map<std::uint32_t, Vec3d> centres;
    for (const SparseImage& image : model.images)
        centres[image.id] = inverse(image.camera_from_world()).t;
    std::vector<double> cosines;
    for (const SparsePoint& point : model.points) {
        std::vector<Vec3d> rays;
        for (const auto& [image, observation] : point.track)
            if (const auto centre = centres.find(image); centre != centres.end())
                rays.push_back(normalize(centre->second - point.position));
        double least = 1;
        for (const Vec3d& a : rays)
            for (const Vec3d& b : rays) least = std::min(least, dot(a, b));
        cosines.push_back(least);
    }
    if (cosines.empty()) return 0;
    return std::acos(std::clamp(middle_of(cosines), -1.0, 1.0)) * 180 / std::numbers::pi;
}

/// Index of the model that contains a photograph; -1: none.
int piece_of(const std::vector<SparseModel>& models, const std::string& name) {
    for (std::size_t i = 0; i < models.size(); ++i)
        if (std::ranges::binary_search(models[i].images, name, {}, &SparseImage::name))
            return static_cast<int>(i);
    return -1;
}

std::string names_of(const MissingRun& run) {
    return run.names.size() == 1
               ? run.names.front()
               : str(run.names.front(), run.names.size() == 2 ? " and " : " to ", run.names.back(),
                     run.names.size() > 2 ? str(" (", run.names.size(), " photographs)") : "");
}

std::string neighbours_of(const MissingRun& run) {
    return run.before.empty() && run.after.empty() ? "beside the photographs with poses"
           : run.before.empty()                    ? str("towards ", run.after)
           : run.after.empty()                     ? str("towards ", run.before)
                               : str("between ", run.before, " and ", run.after);
}

}  // namespace

Check check_models(const std::vector<std::string>& names,
                   const std::vector<SparseModel>& models,
                   const std::map<std::string, int>& features) {
    const SparseModel& model = models.at(0);
    Check check;
    check.photographs = names.size(), check.registered = model.images.size();
    check.points = model.points.size();
    for (const SparseModel& piece : models) check.pieces.push_back(piece.images.size());
    measure_residuals(model, check);
    check.angle_deg = median_angle_deg(model);
    if (check.points > 0)
        check.track_length =
            static_cast<double>(check.observations) / static_cast<double>(check.points);

    std::vector<int> of_registered, of_run;
    std::string before;
    MissingRun run;
    const auto end_run = [&](const std::string& after) {
        if (run.names.empty()) return;
        run.after = after;
        if (!of_run.empty()) run.features = middle_of(of_run);
        check.missing.push_back(run);
        run = {}, of_run.clear();
    };
    for (const std::string& name : names) {
        const int piece = piece_of(models, name);
        const auto found = features.find(name);
        if (piece == 0) {
            end_run(name);
            before = name;
            if (found != features.end()) of_registered.push_back(found->second);
            continue;
        }
        if (piece != run.piece) end_run("");
        if (run.names.empty()) run.before = before, run.piece = piece;
        run.names.push_back(name);
        if (found != features.end()) of_run.push_back(found->second);
    }
    end_run("");
    if (!of_registered.empty()) check.features = middle_of(of_registered);
    return check;
}

void log_check(const Check& check) {
    spdlog::info("{} of {} photographs have poses; {} points, each in {:.1f} photographs",
                 check.registered, check.photographs, grouped(check.points), check.track_length);
    spdlog::info("Reprojection error {:.2f} px on average, {:.2f} px in the worst photograph, {}",
                 check.residual_px, check.worst_px, check.worst);
    spdlog::info("Median triangulation angle {:.0f} degrees (good above 10)", check.angle_deg);
    // degrees; below it, an error of a pixel is several per cent of the depth.
    constexpr double kNarrow = 4;
    if (check.angle_deg < kNarrow)
        spdlog::warn(
            "The photographs were taken from nearly one place, so depth is uncertain; step "
            "sideways between photographs");
    constexpr double kLarge = 1.5;  // pixels; COLMAP's usual results are below 1
    if (check.residual_px > kLarge)
        spdlog::warn(
            "The reprojection error is large: did something move, or did the lens zoom? For zooms "
            "give --cameras each");
    if (check.pieces.size() > 1)
        spdlog::warn(
            "The photographs form {} separate groups, of {}; only the first is kept: add "
            "photographs between them",
            check.pieces.size(), fmt::join(check.pieces, ", "));
    for (const MissingRun& run : check.missing) {
        if (run.piece > 0)
            spdlog::warn(
                "{}: connected with each other, not with the rest: add photographs {}, in small "
                "steps",
                names_of(run), neighbours_of(run));
        else if (run.features >= 0 && run.features < 0.3 * check.features)
            spdlog::warn(
                "{}: no pose; {} features, others have {}: blurred, dark or without texture: take "
                "again, {}",
                names_of(run), run.features, check.features, neighbours_of(run));
        else
            spdlog::warn(
                "{}: no pose; too little overlap: add photographs {}, each sharing two thirds with "
                "the next",
                names_of(run), neighbours_of(run));
    }
}

JsonValue json_of(const Check& check) {
    JsonValue missing = JsonValue::list();
    for (const MissingRun& run : check.missing)
        for (const std::string& name : run.names) missing.items.push_back(name);
    return JsonValue()
        .add("photographs", check.photographs)
        .add("registered", check.registered)
        .add("points", check.points)
        .add("observations", check.observations)
        .add("residual_px", round_to(check.residual_px, 1e-4))
        .add("worst_px", round_to(check.worst_px, 1e-4))
        .add("worst", check.worst)
        .add("track_length", round_to(check.track_length, 1e-3))
        .add("angle_deg", round_to(check.angle_deg, 1e-2))
        .add("pieces", check.pieces)
        .add("missing", missing);
}

}  // namespace tvsgs::prepare
