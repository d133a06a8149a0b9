#include "plan/plan.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "core/error.h"
#include "optim/loop/schedule.h"

namespace tvsgs {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

// Thresholds; docs/guide/plan.md has the runs behind them, and says which have none.
constexpr int kDenseViews = 40;
constexpr double kModelCovers = 0.4, kCloudForDiscs = 0.06;  // points per pixel
constexpr double kDrift = 0.15;
constexpr double kPoseError = 0.5, kPoseExact = 0.25;  // px
// A background of one colour: share of the images' borders, and at most of the initial points.
constexpr double kBackgroundBorder = 0.75, kBackgroundPoints = 0.05;
// Masks: share of the initial points that they leave out; of the images' border that those of an
// object leave out, by degrees up to that much more.
constexpr double kMatchedOutside = 0.5, kObjectBorder = 0.1, kObjectSlope = 0.3, kCoverage = 0.1;
// Of the pixels with texture in two views' common directions, those that both see alike.
constexpr double kSky = 0.02;
// What a cloud needs that covers in full.
constexpr double kPositionWeight = 10;
constexpr int kIterations = 5000, kIterationsPerView = 250, kVoteEvery = 50, kRefreshEvery = 500,
              kOpaqueAfter = 250, kOpaqueShare = 20;
// Normals of stereo: in full up to kFewViews, not at all from kManyViews on.
constexpr int kFewViews = 9, kManyViews = 20;
// Largest meshed splat of kLeastViews, pixels; twice that for each view more, none from kFewViews.
constexpr int kMeshedScalePx = 16, kLeastViews = 3;
constexpr double kLargestScalePx = 1e5;  // none is larger
// Jumps of the depth within a surface that one view alone is trusted on: where no cloud covers, and
// where one does, up to kLeastViews and from kFewViews on. kBareJumpPx is mesh.lone_jump_px'
// default.
constexpr double kBareJumpPx = 0.25, kLeastJumpPx = 0.1, kManyJumpPx = 1;
/// What grows with the pixels of a scene, up to kManyMegapixels.
struct ByPixels {
    const char *decision, *key;
    double few_megapixels, few_px, many_px;
};
constexpr double kManyMegapixels = 9;
constexpr ByPixels kByPixels[] = {{"mesh error", "mesh.error", 2, 0.3, 0.5},
                                  {"mesh voxels", "mesh.voxel_scale", 4.5, 1, 1.25}};

/// What an option is on the way from what no covering cloud needs to what a full one does.
double between(double bare, double covered, double share) {
    return bare + share * (covered - bare);
}
int between(int bare, int covered, double share) {
    return static_cast<int>(std::lround(between(1.0 * bare, 1.0 * covered, share)));
}

/// Three digits, but whole numbers whole.
std::string number(double value) {
    char text[32];
    const bool whole = value == std::floor(value) && std::abs(value) < 1e10;
    std::snprintf(text, sizeof text, "%.*g", whole ? 10 : 3, value);
    return text;
}

/// As an option is set.
std::string rounded(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.5g", value);
    return text;
}

/// "12 < 25".
std::string compared(double measured, double threshold, const char* unit = "") {
    return std::isnan(measured)
               ? str("not known")
               : str(number(measured), unit,
                     measured < threshold ? " < " : " >= ", number(threshold), unit);
}

/// What of the options' schedule is another once it is fitted to other iterations.
Settings schedule_settings(const TrainOptions& options, const TrainOptions& fitted) {
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

Decision plan_poses(const SceneLook& look, const CameraOptions& options) {
    const bool off = look.pose_error >= kPoseError;
    Decision decision{"poses",
                      off ? "refined" : "as given",
                      "no observations of points to measure them by",
                      look.pose_error,
                      kPoseError,
                      {{"cameras.refine", off ? "true" : "false"}}};
    if (std::isnan(look.pose_error)) return decision;
    decision.reason =
        str("off by what their points say, ", compared(look.pose_error, kPoseError, " px"));
    if (off || !options.refine) return decision;
    // Asked for by the user. Points that fit as well as that know more of a pose than photographs.
    const double loose = (look.pose_error - kPoseExact) / (kPoseError - kPoseExact);
    const double bound = std::max(1e-3, loose * static_cast<double>(options.bound_px));
    decision.reason += str("; they move by ", rounded(bound), " px at most");
    decision.settings.emplace_back("cameras.bound_px", rounded(bound));
    return decision;
}

Decision plan_exposure(const SceneLook& look) {
    const bool drifts = look.exposure_drift >= kDrift;
    return {"exposure",
            drifts ? "fitted" : "off",
            std::isnan(look.exposure_drift)
                ? "no two views near each other share enough points"
                : str("brightness of a view where another sees the same, off by ",
                      compared(100 * look.exposure_drift, 100 * kDrift, " %")),
            look.exposure_drift,
            kDrift,
            {{"loss.photometric.exposure", drifts ? "true" : "false"}}};
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

Decision plan_sky(double share) {
    const bool on = share >= kSky;
    Settings settings;
    if (on) settings.emplace_back("loss.photometric.background", "sky");
    return {"sky",
            on ? "behind the splats" : "none",
            std::isnan(share) ? "no two views stand apart and look the same way"
                              : str("pixels that another view sees alike in the same direction: ",
                                    compared(100 * share, 100 * kSky, " %")),
            share,
            kSky,
            settings};
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
    const bool covers = look.points_per_pixel >= kModelCovers;
    // As many as would cover; in proportion where some lie in no view.
    const double wanted = look.points_per_pixel > 0 ? kModelCovers / look.points_per_pixel *
                                                          static_cast<double>(look.points)
                                                    : kModelCovers * look.pixels;
    std::string reason = str("points per pixel: ", compared(look.points_per_pixel, kModelCovers));
    // Whoever tries a scene at a small size must not take its plan for that of the full one.
    if (const double full = look.points_per_pixel / (look.reduction * look.reduction);
        covers != (full >= kModelCovers))
        reason += str("; at the photographs' own size ", compared(full, kModelCovers),
                      ", and the plan another");
    return {"initial cloud",
            covers ? "the model's" : "stereo",
            reason,
            look.points_per_pixel,
            kModelCovers,
            {{"init.min_points", covers ? "0" : number(std::ceil(std::min(wanted + 1, 1e9)))}}};
}

Decision given_coverage(double measured, double given) {
    return {"coverage",
            number(given),
            str("points per pixel, as asked (plan.coverage); ", number(measured), " were measured"),
            measured,
            kNone,
            {}};
}

std::vector<Decision> plan_training(const SceneLook& look, const PlanInputs& in) {
    std::vector<Decision> plan;
    const double points = look.points_per_pixel, share = in.dense ? 0 : covered_share(points);
    const auto by_cloud = [&](const char* name, const std::string& choice, Settings settings) {
        const std::string against =
            share > 0 && share < 1
                ? str(number(points), ", by degrees from ", kSparseCloud, " to ", kCoveringCloud)
                : compared(points, share > 0 ? kCoveringCloud : kSparseCloud);
        plan.push_back({name, choice, str("points per pixel: ", against), points, kSparseCloud,
                        std::move(settings)});
    };
    const int enough = std::max(kIterations, kIterationsPerView * look.train_views),
              iterations = in.wanted >= 0
                               ? in.wanted
                               : between(in.configured, std::min(enough, in.configured), share);
    TrainOptions fitted = in.options;
    fitted.iterations = in.configured;
    fit_schedule(fitted, iterations);
    const Settings schedule = schedule_settings(in.options, fitted);
    const std::string number_of = std::to_string(iterations);
    if (in.wanted >= 0)
        plan.push_back(
            {"iterations", number_of, "as asked; the schedule fits them", kNone, kNone, schedule});
    else if (in.dense)
        plan.push_back({"iterations", number_of, "of the dense settings", kNone, kNone, schedule});
    else {
        by_cloud("iterations", number_of, schedule);
        if (share > 0)
            plan.back().reason +=
                str("; in full ", kIterationsPerView, " per view, ", kIterations, " at least");
    }
    // Whoever asks for growth where the plan has none gets it in full.
    if (!in.dense && share >= 1) by_cloud("densify", "off", {{"densify.enabled", "false"}});
    if (!in.dense && share < 1)
        by_cloud("densify", share > 0 ? str("in gaps, less by ", number(100 * share), " %") : "on",
                 {{"densify.enabled", "true"}, {"densify.spare_covered", rounded(share)}});
    // Files keep three scales, for the viewers of 3DGS.
    if (!in.dense && in.discs && points >= kCloudForDiscs)
        plan.push_back({"rasteriser",
                        "discs",
                        str("points per pixel: ", compared(points, kCloudForDiscs)),
                        points,
                        kCloudForDiscs,
                        {{"backbone", kDiscs}, {"output.ply_scales", "three"}}});
    if (share > 0) {
        const std::string start = std::to_string(between(fitted.loss.normal.start, 1, share));
        by_cloud("normal loss", str("from ", start), {{"loss.normal.start", start}});
    }
    if (share > 0 && in.normals && look.train_views < kManyViews) {
        const double by_views = static_cast<double>(kManyViews - look.train_views) /
                                static_cast<double>(kManyViews - kFewViews);
        const std::string weight = rounded(share * std::min(by_views, 1.0));
        by_cloud("prior normals", str("weight ", weight),
                 // What merely lies beside a scene has not been measured.
                 {{"loss.prior_normal.weight", weight}, {"priors.source", "stereo"}});
        plan.back().reason += str("; training views: ", compared(look.train_views, kManyViews),
                                  ", ", kFewViews, " or fewer: in full");
    }
    // A larger one lies in a gap of the cloud, at a depth that nothing has measured.
    if (share > 0 && look.train_views < kFewViews) {
        const int least = kMeshedScalePx << std::max(0, look.train_views - kLeastViews);
        const std::string px = rounded(std::min(least / share, kLargestScalePx));
        by_cloud("meshed splats", str("up to ", px, " px"), {{"mesh.max_scale_px", px}});
        plan.back().reason += str("; training views: ", compared(look.train_views, kFewViews), ", ",
                                  kLeastViews, " or fewer: ", kMeshedScalePx, " in full");
    }
    // With more views what one alone has seen is right more often, rough as it is.
    if (share > 0) {
        const double many = std::clamp(static_cast<double>(look.train_views - kLeastViews) /
                                           static_cast<double>(kFewViews - kLeastViews),
                                       0.0, 1.0);
        const double covered_px = kLeastJumpPx * std::pow(kManyJumpPx / kLeastJumpPx, many),
                     jump_px = kBareJumpPx * std::pow(covered_px / kBareJumpPx, share);
        by_cloud("lone views", str("up to ", number(jump_px), " px"),
                 {{"mesh.lone_jump_px", rounded(jump_px)}});
        plan.back().reason += str("; training views: ", compared(look.train_views, kFewViews), ", ",
                                  kLeastViews, " or fewer: ", kLeastJumpPx);
    }
    for (const ByPixels& by : kByPixels) {
        if (!(look.megapixels > by.few_megapixels)) continue;
        const double many = std::min(
            (look.megapixels - by.few_megapixels) / (kManyMegapixels - by.few_megapixels), 1.0);
        const std::string px = rounded(by.few_px + many * (by.many_px - by.few_px));
        plan.push_back({by.decision,
                        str(px, " px"),
                        str("megapixels of the training views: ", number(look.megapixels), "; ",
                            by.few_px, " px up to ", by.few_megapixels, ", ", by.many_px, " from ",
                            kManyMegapixels, " on"),
                        look.megapixels,
                        by.few_megapixels,
                        {{by.key, px}}});
    }
    if (share > 0 && in.options.tv.enabled) {
        const TrainOptions& o = in.options;
        const std::string votes = std::to_string(between(o.tv.vote_every, kVoteEvery, share)),
                          search =
                              std::to_string(between(o.tv.refresh_every, kRefreshEvery, share)),
                          weight = rounded(between(static_cast<double>(o.loss.tv_position.weight),
                                                   kPositionWeight, share));
        by_cloud("votes", str("every ", votes), {{"tv.vote_every", votes}});
        by_cloud("position loss", str("weight ", weight), {{"loss.tv_position.weight", weight}});
        by_cloud("neighbours", str("every ", search), {{"tv.refresh_every", search}});
    }
    if (in.dense || share > 0) {
        const bool on = look.views_in_wide_pairs > 0;
        const double strength = !on ? 0 : in.dense ? 1 : share;
        // Until the splats are opaque, the depths compared are means of near and far ones. That
        // takes as many iterations however long the training is; a short one cannot wait.
        const std::string start =
            std::to_string(std::clamp(iterations / kOpaqueShare, 1, kOpaqueAfter));
        Settings settings, starts;
        for (const TermOnList& term : terms_on_list(in.multi_view)) {
            if (term.needs.other_views == 0 || !(term.weight > 0)) continue;
            settings.emplace_back(str("loss.", term.key, ".weight"),
                                  rounded(strength * static_cast<double>(term.weight)));
            starts.emplace_back(str("loss.", term.key, ".start"), start);
        }
        settings.emplace_back("loss.multi_view.limits", "relative");
        settings.emplace_back("loss.multi_view.lone_angle_deg", str(kWideAngleDeg));
        if (on && !in.dense) settings.insert(settings.end(), starts.begin(), starts.end());
        const std::string choice = on ? str(number(100 * strength), " %") : "off",
                          pairs = str("views with another within ",
                                      in.options.loss.multi_view.max_angle_deg,
                                      " degrees: ", number(look.views_in_pairs),
                                      ", with the others up to ", kWideAngleDeg, ": ",
                                      number(look.views_in_wide_pairs));
        if (in.dense)
            plan.push_back({"multi-view", choice, pairs, look.views_in_wide_pairs, 0, settings});
        else {
            by_cloud("multi-view", choice, settings);
            plan.back().reason += str("; ", pairs);
        }
    }
    // Where masks leave out nothing that is shown: what is seen there is splats of that colour at
    // any depth, or none.
    const MaskUse use = in.options.loss.photometric.masks;
    const bool masked = use == MaskUse::object || (uses_masks(use) && look.outside);
    const bool sky = in.options.loss.photometric.background == "sky";
    if (!masked && !sky && look.background_border > 0) {
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
    plan.push_back(plan_poses(look, in.options.cameras));
    plan.push_back(plan_exposure(look));
    return plan;
}

}  // namespace tvsgs
