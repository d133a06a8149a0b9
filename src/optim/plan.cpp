#include "optim/plan.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "core/error.h"
#include "optim/schedule.h"

namespace tvsgs {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

// Thresholds; docs/plan.md has the runs behind them, and says which have none.
constexpr int kDenseViews = 40;
constexpr double kCoveringCloud = 0.25;  // points per pixel
constexpr double kPaired = 0.5;          // share of the views
constexpr double kDrift = 0.15, kColorDrift = 0.01;
// A background of one colour: share of the images' borders, and at most of the initial points.
constexpr double kBackgroundBorder = 0.75, kBackgroundPoints = 0.05;
// Masks: share of the initial points that they leave out; of the images' border that those of an
// object leave out, by degrees up to that much more.
constexpr double kMatchedOutside = 0.5, kObjectBorder = 0.1, kObjectSlope = 0.3, kCoverage = 0.1;
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

/// A colour matrix is the freer the more it explains: where that is little it is held at none, so
/// that it comes by degrees.
Decision plan_exposure(const SceneLook& look) {
    const bool drifts = look.exposure_drift >= kDrift,
               matrix = drifts && look.color_drift >= kColorDrift;
    Decision decision{"exposure",
                      matrix   ? "with a colour matrix"
                      : drifts ? "fitted"
                               : "off",
                      "no two views near each other share enough points",
                      look.exposure_drift,
                      kDrift,
                      {{"loss.photometric.exposure", matrix   ? "affine"
                                                     : drifts ? "true"
                                                              : "false"}}};
    if (!std::isnan(look.exposure_drift))
        decision.reason = str("brightness of a view where another sees the same, off by ",
                              compared(100 * look.exposure_drift, 100 * kDrift, " %"));
    if (drifts && !std::isnan(look.color_drift))
        decision.reason += str("; of its colours a matrix explains more than a gain: ",
                               compared(100 * look.color_drift, 100 * kColorDrift, " %"));
    if (matrix) {
        const double share = std::min(look.color_drift / kColorDrift, 9.0) / 3;
        decision.settings.emplace_back("loss.photometric.exposure_pull",
                                       number(0.01 / (share * share)));
    }
    return decision;
}

}  // namespace

std::string summary(const SceneLook& look) {
    return str(look.train_views, " train, ", look.test_views, " test; ", look.points,
               " initial points, ", number(look.points_per_pixel), " per pixel of the ",
               number(100 * look.matchable), " % that could be matched");
}

std::vector<Decision> plan_masks(const MaskLook& look) {
    if (look.masked == 0) return {};
    const std::string found = str("masks: ", look.masked, " of ", look.views, " training views");
    const auto decision = [&](const char* choice, const std::string& reason, Settings settings) {
        settings.emplace_back("loss.photometric.masks", choice);
        return std::vector<Decision>{{"masks", choice, str(found, "; ", reason), look.border,
                                      kObjectBorder, std::move(settings)}};
    };
    if (look.outside == 0)
        return decision("ignore", "they leave out only what the lenses did not see", {});
    if (!look.empty.empty())
        return decision("none", str("that of ", look.empty, " has no pixel of the object"), {});
    // What has been matched there has a place, too, and holds what is beside the object in its own.
    if (look.matched >= kMatchedOutside)
        return decision(
            "none", str("of the initial points outside: ", compared(look.matched, kMatchedOutside)),
            {});
    const std::string border =
        str("of the initial points outside: ", compared(look.matched, kMatchedOutside),
            "; of the images' border outside: ", compared(look.border, kObjectBorder));
    if (look.border < kObjectBorder) return decision("ignore", border, {});
    const double full = std::min(1.0, (look.border - kObjectBorder) / kObjectSlope);
    return decision(
        "object", str(border, "; in full from ", number(kObjectBorder + kObjectSlope)),
        {{"loss.photometric.coverage", number(std::round(100 * full) / 100 * kCoverage)}});
}

Decision plan_settings(int train_views, bool measured_points) {
    const bool dense = train_views >= kDenseViews && !measured_points;
    return {"settings",
            dense ? "dense" : "sparse",
            measured_points ? "measured points vote, for which the dense settings have no votes"
                            : str("training views: ", compared(train_views, kDenseViews)),
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
    // Where masks leave out nothing that is shown: what is seen there is splats of that colour at
    // any depth, or none.
    const MaskUse use = in.options.loss.photometric.masks;
    const bool masked = use == MaskUse::object || (uses_masks(use) && look.outside);
    if (!masked && look.background_border > 0) {
        const bool one = look.background_border >= kBackgroundBorder &&
                         look.background_points < kBackgroundPoints;
        const std::string color =
            str(look.background[0], ",", look.background[1], ",", look.background[2]);
        plan.push_back({"background",
                        one ? color : "none",
                        str("of the images' border in one colour: ",
                            compared(look.background_border, kBackgroundBorder),
                            "; of the initial points there: ",
                            compared(look.background_points, kBackgroundPoints)),
                        look.background_border,
                        kBackgroundBorder,
                        {{"loss.photometric.background", one ? color : "none"}}});
    }
    plan.push_back(plan_exposure(look));
    return plan;
}

}  // namespace tvsgs
