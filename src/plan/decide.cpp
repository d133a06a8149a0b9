#include "plan/decide.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "core/grouped.h"
#include "plan/figures.h"

namespace tvsgs {
namespace {

// Thresholds. docs/results/plan.md has the runs behind them; docs/guide/plan.md names those that
// were not measured.
constexpr int kDenseViews = 40;
// Points per pixel: of a model that needs no stereo, and of a cloud by stereo.
constexpr double kModelCovers = 0.4, kStereoPoints = 0.6;
constexpr std::size_t kLeastPoints = 100;  // to start from
constexpr double kLeastCovered = 0.01;     // share of the photographs
constexpr double kBehind = 0.9;            // share of points and cameras; 0.5 in a room is usual
// Masks: share of the initial points outside; share of the images' border outside that makes them
// masks of an object, and of full coverage above it.
constexpr double kMatchedOutside = 0.5, kObjectBorder = 0.1, kObjectSlope = 0.3, kCoverage = 0.1;
// Share of the textured pixels that two views see alike in the same direction.
constexpr double kSky = 0.02;

}  // namespace

std::vector<Decision> decide_photographs(const PhotoStorage& storage) {
    if (!storage.in_file) return {};
    return {{"photographs",
             "in a file",
             storage.reason(),
             double(storage.bytes) / 1e9,
             double(storage.limit) / 1e9,
             {{"scene.photos", "file"}}}};
}

Decision decide_settings(int train_views, bool measured_points) {
    const bool dense = train_views >= kDenseViews && !measured_points;
    return {"preset",
            dense ? kManyPhotographs : kFewPhotographs,
            measured_points ? std::string("measured points vote, and only this preset has votes")
                            : str(dense ? "" : "fewer than ", kDenseViews, dense ? " or more" : ""),
            double(train_views),
            kDenseViews,
            {},
            dense ? kManyPhotographs : kFewPhotographs};
}

std::vector<Decision> decide_masks(const MaskLook& look) {
    if (look.masked == 0) return {};
    const std::string found = str(look.masked, " of ", look.views, " photographs have one");
    const auto decision = [&](const std::string& choice, const std::string& reason,
                              Settings settings) {
        settings.emplace_back("loss.photometric.masks", choice);
        return std::vector<Decision>{{"masks", choice, str(found, "; ", reason), look.border,
                                      kObjectBorder, std::move(settings),
                                      look.outside == 0  ? ""
                                      : choice == "none" ? "masks not used"
                                                         : "masks used"}};
    };
    if (look.outside == 0)
        return decision("ignore", "they leave out only pixels that the lens did not see", {});
    if (!look.empty.empty())
        return decision("none", str("the mask of ", look.empty, " has no pixel of the object"), {});
    // Points outside have a place, which keeps the surroundings apart from the object.
    const std::string outside = str(percent(look.matched), " of the start points are outside");
    if (look.matched >= kMatchedOutside)
        return decision("none", str(outside, ", less than ", percent(kMatchedOutside), " allowed"),
                        {});
    const std::string border = str(outside, " and ", percent(look.border), " of the borders");
    if (look.border < kObjectBorder)
        return decision("ignore", str(border, ", ", percent(kObjectBorder), " for an object"), {});
    const double full = std::min(1.0, (look.border - kObjectBorder) / kObjectSlope);
    return decision(
        "object", str(border, ", full weight from ", percent(kObjectBorder + kObjectSlope), " on"),
        {{"loss.photometric.coverage", number(std::round(100 * full) / 100 * kCoverage)}});
}

Decision decide_cloud(const SceneLook& look, bool dense) {
    if (dense) {
        const int least = InitOptions{}.min_points;
        const auto points = double(look.points);
        return {"start points",
                points < least ? "stereo" : "the model's",
                str(grouped(look.points), " points, ", grouped(least), " needed"),
                points,
                1.0 * least,
                {{"init.min_points", std::to_string(least)}},
                points < least ? "start points by stereo" : ""};
    }
    const bool covers = look.points_per_pixel >= kModelCovers;
    // Textured pixels of the whole scene, in proportion to the points that views see.
    const bool seen = look.points_per_pixel > 0;
    const double scene_pixels = seen ? double(look.points) / look.points_per_pixel : look.pixels;
    std::string reason = str("the model has ", short_figure(look.points_per_pixel),
                             " per textured pixel; stereo makes more below ", kModelCovers);
    // A trial at a small size must not promise the plan of the full size.
    if (const double full = look.points_per_pixel / (look.reduction * look.reduction);
        covers != (full >= kModelCovers))
        reason += str("; at the photographs' full size ", short_figure(full),
                      ": the plan may be another");
    const auto whole = [](double points) { return number(std::ceil(std::min(points, 1e9))); };
    Settings settings{{"init.min_points", covers ? "0" : whole(kModelCovers * scene_pixels + 1)}};
    if (!covers && seen) {
        reason += str(", up to ", kStereoPoints);
        settings.emplace_back("init.max_points", whole(kStereoPoints * scene_pixels));
    }
    return {"start points",
            covers ? "the model's" : "stereo",
            reason,
            look.points_per_pixel,
            kModelCovers,
            std::move(settings),
            covers ? "" : "start points by stereo"};
}

std::string start_fault(const StartLook& look) {
    if (look.points >= kLeastPoints && look.covered >= kLeastCovered) return {};
    return str(grouped(look.points), " start points on ", percent(look.covered),
               " of the photographs; expected at least ", kLeastPoints, " on ",
               percent(kLeastCovered),
               look.behind > kBehind ? "; they lie behind the cameras: the poses are wrong, see "
                                       "docs/guide/input.md#conventions"
                                     : "");
}

Decision decide_sky(double share) {
    const bool on = share >= kSky;
    Settings settings;
    if (on) settings.emplace_back("loss.photometric.background", "sky");
    return {"sky",
            on ? "behind the splats" : "none",
            std::isnan(share) ? "no two photographs stand apart and look the same way"
                              : str(percent(share),
                                    " of the textured pixels look alike in the "
                                    "same direction, a sky from ",
                                    percent(kSky), " on"),
            share,
            kSky,
            settings,
            on ? "sky behind the splats" : ""};
}

Decision decide_background(double share_beyond, bool masked) {
    constexpr double kMuch = 0.05;
    const bool meshed = share_beyond >= kMuch;
    return {"mesh bounds",
            meshed ? "unbounded" : "twice the object's distance",
            std::isnan(share_beyond)
                ? std::string("the distance of the points is not known")
                : str(percent(share_beyond), " of the points", masked ? " inside the masks" : "",
                      " lie farther, unbounded from ", percent(kMuch), " on"),
            share_beyond,
            kMuch,
            {{"mesh.unbounded", meshed ? "true" : "false"}}};
}

Decision decide_confirmed(const SceneLook& look) {
    const double share = look.views_in_widest_pairs * comparable(look.pair_angle_deg);
    return {
        "confirmed surface",
        share > 0 ? str("where ", percent(share / 2), " around a face is confirmed") : "not needed",
        str(percent(look.views_in_widest_pairs), " of the photographs have another within ",
            kWidestAngleDeg, " degrees",
            look.views_in_widest_pairs > 0
                ? str(", in the median ", short_figure(look.pair_angle_deg))
                : ""),
        look.views_in_widest_pairs,
        0,
        {{"mesh.measured", rounded(share / 2)}}};
}

std::vector<Decision> decide_object(const CommonBall& ball) {
    // Interpolates 1 / radius. A room has cameras on all sides, too, but points on its walls.
    constexpr double kAllSides = 0.3, kOneSide = 0.5, kFewPoints = 0.25, kManyPoints = 0.5;
    const double share =
        std::clamp((kOneSide - ball.one_sidedness) / (kOneSide - kAllSides), 0.0, 1.0) *
        std::clamp((ball.points - kFewPoints) / (kManyPoints - kFewPoints), 0.0, 1.0);
    if (!(share > 0)) return {};
    return {
        {"object",
         str("meshed alone, ", short_figure(ball.radius / share), " units around the focus"),
         str("cameras on all sides (mean direction ", short_figure(ball.one_sidedness), ", below ",
             kOneSide, "); ", percent(ball.points), " of the points near the focus"),
         ball.one_sidedness,
         kOneSide,
         {{"mesh.object", rounded(1 / share)}, {"mesh.unbounded", "false"}}}};
}

Decision decide_coverage(double measured, double given) {
    return {"coverage",
            number(given),
            str("start points per textured pixel from plan.coverage; measured ",
                short_figure(measured)),
            measured,
            kNone,
            {}};
}

Decision drop_voting_losses() {
    return {"voting losses", "off",
            "voting is off", kNone,
            kNone,           {{"loss.tv_normal.weight", "0"}, {"loss.tv_position.weight", "0"}}};
}

std::vector<Decision> drop_thickness_losses(const TrainOptions& options) {
    const auto backbone = make_backbone<Cpu>(options.backbone, options.render);
    const char* const why = backbone->traits.flat ? "the splats are flat"
                            : backbone->traits.fades_thin_splats
                                ? "the rasteriser fades thin splats"
                                : nullptr;
    std::vector<Decision> dropped;
    for (const TermOnList& term : terms_on_list(options.loss))
        if (why != nullptr && term.needs.thickness && term.weight > 0)
            dropped.push_back({str(term.key, " loss"),
                               "off",
                               why,
                               kNone,
                               kNone,
                               {{str("loss.", term.key, ".weight"), "0"}}});
    return dropped;
}

}  // namespace tvsgs
