#include "optim/plan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>
#include <optional>

#include "core/error.h"
#include "optim/schedule.h"
#include "optim/view_pairs.h"

namespace tvsgs {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

double median(std::vector<double>& values) {
    if (values.empty()) return kNone;
    // Of an even number the lower one, so that half of them at least are as large.
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

constexpr int kReach = 2, kSide = 2 * kReach + 1;
using Patch = std::array<double, kSide * kSide>;

/// Grey levels around the place where a point projects, 0 to 255; nothing where they leave the
/// image.
std::optional<Patch> patch_at(const View& view, Vec3f point) {
    const Camera& c = view.camera;
    if (!is_in_view(c, point)) return std::nullopt;
    const Vec3f p = c.camera_from_world * point;
    const int x = static_cast<int>(c.fx_px * p.x / p.z + c.cx_px),
              y = static_cast<int>(c.fy_px * p.y / p.z + c.cy_px);
    if (x < kReach || y < kReach || x + kReach >= view.photo.width ||
        y + kReach >= view.photo.height)
        return std::nullopt;
    Patch patch;
    for (int i = 0; i < kSide * kSide; ++i) {
        const int at_x = x + i % kSide - kReach, at_y = y + i / kSide - kReach;
        patch[static_cast<std::size_t>(i)] =
            (view.photo.at(at_x, at_y, 0) + view.photo.at(at_x, at_y, 1) +
             view.photo.at(at_x, at_y, 2)) /
            3.0;
    }
    return patch;
}

/// Logarithm of the ratio of two patches' brightness; nothing where they do not look alike, as
/// where something else hides the point from a view, or where they are flat, dark or saturated.
std::optional<double> log_gain(const Patch& a, const Patch& b) {
    const auto mean = [](const Patch& p) {
        return std::accumulate(p.begin(), p.end(), 0.0) / static_cast<double>(p.size());
    };
    const double mean_a = mean(a), mean_b = mean(b);
    double aa = 0, bb = 0, ab = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        const double da = a[i] - mean_a, db = b[i] - mean_b;
        aa += da * da, bb += db * db, ab += da * db;
    }
    constexpr double kFlat = 4 * kSide * kSide;  // two grey levels of deviation: noise
    const bool alike = std::min(aa, bb) > kFlat && ab > 0.8 * std::sqrt(aa * bb);
    if (!alike || std::min(mean_a, mean_b) < 10 || std::max(mean_a, mean_b) > 245)
        return std::nullopt;
    return std::log(mean_a / mean_b);
}

/// For every view the one whose optical axis is nearest to its own, within 30 degrees; -1: none.
/// What such two see is hidden from few of either.
std::vector<int> nearest_views(const Scene& scene) {
    const int views = static_cast<int>(scene.train.size());
    const auto axis = [&](int v) {
        return optical_axis(scene.train[static_cast<std::size_t>(v)].camera);
    };
    std::vector<int> nearest(scene.train.size(), -1);
    for (int v = 0; v < views; ++v) {
        double best = 0.866;  // 30 degrees
        for (int other = 0; other < views; ++other)
            if (const double cosine = dot(axis(v), axis(other)); other != v && cosine > best)
                best = cosine, nearest[static_cast<std::size_t>(v)] = other;
    }
    return nearest;
}

}  // namespace

SceneLook look_at(const Scene& scene, const ViewPairOptions& limits) {
    const std::vector<Vec3f>& points = scene.points.positions;
    constexpr std::size_t kSample = 4000;  // tells a median to a percent or two
    const std::size_t stride = 1 + points.size() / kSample;
    const std::vector<int> nearest = nearest_views(scene);
    SceneLook look;
    look.train_views = static_cast<int>(scene.train.size());
    look.test_views = static_cast<int>(scene.test.size());
    look.points = points.size();
    look.exposure_drift = kNone;
    std::vector<double> pixels, per_pixel, reductions;
    for (std::size_t v = 0; v < scene.train.size(); ++v) {
        const View& view = scene.train[v];
        const View* const other =
            nearest[v] < 0 ? nullptr : &scene.train[static_cast<std::size_t>(nearest[v])];
        std::size_t inside = 0;
        std::vector<double> gains;  // logarithms
        for (std::size_t i = 0; i < points.size(); i += stride) {
            if (!is_in_view(view.camera, points[i])) continue;
            ++inside;
            if (other == nullptr) continue;
            const auto here = patch_at(view, points[i]), there = patch_at(*other, points[i]);
            if (!here || !there) continue;
            if (const auto gain = log_gain(*here, *there)) gains.push_back(*gain);
        }
        pixels.push_back(static_cast<double>(view.camera.width_px) * view.camera.height_px);
        per_pixel.push_back(static_cast<double>(inside * stride) / pixels.back());
        reductions.push_back(view.reduction);
        if (gains.size() < 30) continue;  // a median of fewer says little
        const double drift = std::abs(std::expm1(median(gains)));
        look.exposure_drift =
            std::isnan(look.exposure_drift) ? drift : std::max(drift, look.exposure_drift);
    }
    look.pixels = median(pixels);
    look.points_per_pixel = median(per_pixel);
    look.reduction = median(reductions);
    ViewPairOptions relative = limits;
    relative.limits = PairLimits::relative;  // these hold in any unit
    look.views_in_pairs = share_with_pair(scene, relative);
    relative.max_angle_deg = std::max(relative.max_angle_deg, kWideAngleDeg);
    look.views_in_wide_pairs = share_with_pair(scene, relative);
    return look;
}

namespace {

// Thresholds; docs/plan.md has the runs behind them, and says which have none.
constexpr int kDenseViews = 40;
constexpr double kCoveringCloud = 0.25;  // points per pixel
constexpr double kPaired = 0.5;          // share of the views
constexpr double kDrift = 0.15;
// What a covering cloud needs.
constexpr int kIterations = 5000, kIterationsPerView = 250, kVoteEvery = 50, kRefreshEvery = 500,
              kPositionWeight = 10, kOpaqueAfter = 250, kOpaqueShare = 20;
// Normals of stereo: in full up to kFewViews, not at all from kManyViews on.
constexpr int kFewViews = 9, kManyViews = 20;
// Largest meshed splat of kLeastViews, pixels; twice that for each view more, none from kFewViews.
constexpr int kMeshedScalePx = 16, kLeastViews = 3;

/// Three digits, but whole numbers whole.
std::string number(double value) {
    char text[32];
    const bool whole = value == std::floor(value) && std::abs(value) < 1e10;
    std::snprintf(text, sizeof text, "%.*g", whole ? 10 : 3, value);
    return text;
}

/// "12 < 25".
std::string compared(double measured, double threshold, const char* unit = "") {
    return std::isnan(measured)
               ? str("not known")
               : str(number(measured), unit,
                     measured < threshold ? " < " : " >= ", number(threshold), unit);
}

/// The options' schedule, made for `configured` iterations, fitted to others: what changes by it.
Settings schedule_settings(const TrainOptions& options, int configured, int iterations) {
    TrainOptions fitted = options;
    fitted.iterations = configured;
    fit_schedule(fitted, iterations);
    std::vector<int> before;
    visit_schedule(options,
                   [&](const std::string&, int number, Counts) { before.push_back(number); });
    Settings settings;
    std::size_t next = 0;
    visit_schedule(fitted, [&](const std::string& key, int number, Counts) {
        if (const int was = before[next++]; number != was || key == "iterations")
            settings.emplace_back(key, std::to_string(number));
    });
    return settings;
}

}  // namespace

std::string summary(const SceneLook& look) {
    return str(look.train_views, " train, ", look.test_views, " test; ", look.points,
               " initial points, ", number(look.points_per_pixel), " per pixel");
}

Decision plan_settings(int train_views) {
    return {"settings",
            train_views >= kDenseViews ? "dense" : "sparse",
            str("training views: ", compared(train_views, kDenseViews)),
            static_cast<double>(train_views),
            kDenseViews,
            {}};
}

Decision plan_cloud(const SceneLook& look, bool dense) {
    if (dense) {
        const int least = InitOptions{}.min_points;
        const auto points = static_cast<double>(look.points);
        return {"initial cloud",
                points < least ? "stereo" : "the model's",
                str("points: ", compared(points, least)),
                points,
                1.0 * least,
                {{"init.min_points", std::to_string(least)}}};
    }
    const bool covers = look.points_per_pixel >= kCoveringCloud;
    // As many as would cover; in proportion where some lie in no view.
    const double wanted = look.points_per_pixel > 0 ? kCoveringCloud / look.points_per_pixel *
                                                          static_cast<double>(look.points)
                                                    : kCoveringCloud * look.pixels;
    std::string reason = str("points per pixel: ", compared(look.points_per_pixel, kCoveringCloud));
    // Whoever tries a scene at a small size must not take its plan for that of the full one.
    if (const double full = look.points_per_pixel / (look.reduction * look.reduction);
        covers != (full >= kCoveringCloud))
        reason += str("; at the photographs' own size ", compared(full, kCoveringCloud),
                      ", and the plan another");
    return {"initial cloud",
            covers ? "the model's" : "stereo",
            reason,
            look.points_per_pixel,
            kCoveringCloud,
            {{"init.min_points", covers ? "0" : number(std::ceil(std::min(wanted + 1, 1e9)))}}};
}

std::vector<Decision> plan_training(const SceneLook& look, const PlanInputs& in) {
    std::vector<Decision> plan;
    const bool covered = !in.dense && look.points_per_pixel >= kCoveringCloud;
    const std::string cloud =
        str("points per pixel: ", compared(look.points_per_pixel, kCoveringCloud));
    const auto by_cloud = [&](const char* name, const std::string& choice, Settings settings) {
        plan.push_back(
            {name, choice, cloud, look.points_per_pixel, kCoveringCloud, std::move(settings)});
    };
    const int enough = std::max(kIterations, kIterationsPerView * look.train_views),
              iterations = in.wanted > 0 ? in.wanted
                           : covered     ? std::min(enough, in.configured)
                                         : in.configured;
    const Settings schedule = schedule_settings(in.options, in.configured, iterations);
    const std::string number_of = std::to_string(iterations);
    if (in.wanted > 0)
        plan.push_back(
            {"iterations", number_of, "as asked; the schedule fits them", kNone, kNone, schedule});
    else if (in.dense)
        plan.push_back({"iterations", number_of, "of the dense settings", kNone, kNone, schedule});
    else {
        by_cloud("iterations", number_of, schedule);
        if (covered)
            plan.back().reason +=
                str("; ", kIterationsPerView, " per view, ", kIterations, " at least");
    }
    if (!in.dense)
        by_cloud("densify", covered ? "off" : "on",
                 {{"densify.enabled", covered ? "false" : "true"}});
    // Files keep three scales, for the viewers of 3DGS.
    if (covered && in.discs)
        by_cloud("rasteriser", "discs", {{"backbone", kDiscs}, {"output.ply_scales", "three"}});
    if (covered) by_cloud("normal loss", "from the start", {{"loss.normal.start", "1"}});
    if (covered && in.normals && look.train_views < kManyViews) {
        const double share = static_cast<double>(kManyViews - look.train_views) /
                             static_cast<double>(kManyViews - kFewViews);
        const std::string weight = number(std::min(std::round(100 * share) / 100, 1.0));
        plan.push_back({"prior normals",
                        str("weight ", weight),
                        str("training views: ", compared(look.train_views, kManyViews), "; ",
                            kFewViews, " or fewer: 1"),
                        static_cast<double>(look.train_views),
                        kManyViews,
                        // What merely lies beside a scene has not been measured.
                        {{"loss.prior_normal.weight", weight}, {"priors.source", "stereo"}}});
    }
    // A larger one lies in a gap of the cloud, at a depth that nothing has measured.
    if (covered && look.train_views < kFewViews) {
        const std::string px =
            std::to_string(kMeshedScalePx << std::max(0, look.train_views - kLeastViews));
        plan.push_back({"meshed splats",
                        str("up to ", px, " px"),
                        str("training views: ", compared(look.train_views, kFewViews), "; ",
                            kLeastViews, " or fewer: ", kMeshedScalePx),
                        static_cast<double>(look.train_views),
                        kFewViews,
                        {{"mesh.max_scale_px", px}}});
    }
    if (covered && in.options.tv.enabled) {
        by_cloud("votes", str("every ", kVoteEvery),
                 {{"tv.vote_every", std::to_string(kVoteEvery)}});
        by_cloud("position loss", str("weight ", kPositionWeight),
                 {{"loss.tv_position.weight", std::to_string(kPositionWeight)}});
        by_cloud("neighbours", str("every ", kRefreshEvery),
                 {{"tv.refresh_every", std::to_string(kRefreshEvery)}});
    }
    if (in.dense || covered) {
        const bool near = look.views_in_pairs >= kPaired,
                   on = near || look.views_in_wide_pairs >= kPaired;
        const double share = near ? look.views_in_pairs : look.views_in_wide_pairs;
        // Until the splats are opaque, the depths compared are means of near and far ones. That
        // takes as many iterations however long the training is; a short one cannot wait.
        const std::string start =
            std::to_string(std::clamp(iterations / kOpaqueShare, 1, kOpaqueAfter));
        Settings settings, starts;
        for (const TermOnList& term : terms_on_list(in.multi_view)) {
            if (term.needs.other_views == 0 || !(term.weight > 0)) continue;
            settings.emplace_back(str("loss.", term.key, ".weight"),
                                  on ? number(static_cast<double>(term.weight)) : "0");
            starts.emplace_back(str("loss.", term.key, ".start"), start);
        }
        settings.emplace_back("loss.multi_view.limits", "relative");
        if (on && !near) settings.emplace_back("loss.multi_view.max_angle_deg", str(kWideAngleDeg));
        if (on && covered) settings.insert(settings.end(), starts.begin(), starts.end());
        const float widest = std::max(in.options.loss.multi_view.max_angle_deg, kWideAngleDeg);
        const std::string of = near ? str("views in a pair: ")
                                    : str("views with one up to ", widest, " degrees away: ");
        plan.push_back({"multi-view",
                        !on    ? "off"
                        : near ? "on"
                               : "wide",
                        of + compared(share, kPaired), share, kPaired, settings});
    }
    const bool drifts = look.exposure_drift >= kDrift;
    plan.push_back({"exposure",
                    drifts ? "fitted" : "off",
                    std::isnan(look.exposure_drift)
                        ? "no two views near each other share enough points"
                        : str("brightness of a view where another sees the same, off by ",
                              compared(100 * look.exposure_drift, 100 * kDrift, " %")),
                    look.exposure_drift,
                    kDrift,
                    {{"loss.photometric.exposure", drifts ? "true" : "false"}}});
    return plan;
}

}  // namespace tvsgs
