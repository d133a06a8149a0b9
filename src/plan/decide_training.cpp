#include <algorithm>
#include <cmath>

#include "core/grouped.h"
#include "optim/loop/schedule.h"
#include "plan/decide.h"
#include "plan/figures.h"

namespace tvsgs {
namespace {

// Thresholds. docs/results/plan.md has the runs behind them; docs/guide/plan.md names those that
// were not measured.
constexpr double kCloudForDiscs = 0.06;  // points per pixel
constexpr double kDrift = 0.15;
constexpr double kPoseError = 0.5, kPoseExact = 0.25;  // px
// A background of one colour: share of the images' borders, and at most of the initial points.
constexpr double kBackgroundBorder = 0.75, kBackgroundPoints = 0.05;
// Settings for a cloud that covers the scene.
constexpr double kPositionWeight = 10;
constexpr int kIterations = 5000, kIterationsPerView = 250, kVoteEvery = 50, kRefreshEvery = 500,
              kOpaqueAfter = 250, kOpaqueShare = 20;
// A start by stereo: iterations at kLeastViews, their largest sum, iterations per view where these
// are more; pixels between points in gaps; opacity; share of the iterations in which the
// photometric share rises to 1 at kFewViews; lr.supported from kFewViews on.
constexpr int kSupportedLeast = 800, kSupportedMost = 2500, kManyPerView = 125, kGapPx = 2;
constexpr double kOpaque = 0.95, kRising = 0.3, kFreeRates = 3;
// Share of the splats that an iteration leaves out, and ratio of their two largest axes.
constexpr double kDropout = 0.05, kLongestAxis = 4;
// Normals of stereo: in full up to kFewViews, not at all from kManyViews on.
constexpr int kFewViews = 9, kManyViews = 20;
// Largest meshed splat, pixels; without a start by stereo of kLeastViews, twice that for each more.
constexpr int kMeshedScalePx = 16, kLeastViews = 3;
// Votes after a start by stereo: in full up to kLeastViews, none from here on.
constexpr int kViewsWithoutVotes = 6;
constexpr double kLargestScalePx = 1e5;  // none is larger
// Depth jumps within a surface that a single view sees: without a covering cloud (the default of
// mesh.single_view_jump_px), and with one for up to kLeastViews and from kFewViews on.
constexpr double kBareJumpPx = 0.25, kLeastJumpPx = 0.1, kManyJumpPx = 1;
/// Grows with the pixels of a scene, up to kManyMegapixels.
struct ByPixels {
    const char *decision, *key;
    double few_megapixels, few_px, many_px;
};
constexpr double kManyMegapixels = 9;
constexpr ByPixels kByPixels[] = {{"mesh error", "mesh.error", 2, 0.3, 0.5},
                                  {"mesh voxels", "mesh.voxel_scale", 4.5, 1, 1.25}};

/// Interpolates from the value without a covering cloud to the value with one.
double between(double bare, double covered, double share) {
    return bare + share * (covered - bare);
}
int between(int bare, int covered, double share) {
    return int(std::lround(between(1.0 * bare, 1.0 * covered, share)));
}

/// The keys of the schedule that change when it is fitted to other iterations.
Settings schedule_settings(const TrainOptions& options, const TrainOptions& fitted) {
    const std::vector<int> before = schedule_numbers(options);
    Settings settings;
    std::size_t next = 0;
    visit_schedule(fitted, [&](const std::string& key, int number, Counts) {
        if (const int was = before[next++]; number != was || key == "iterations")
            settings.emplace_back(key, std::to_string(number));
    });
    return settings;
}

/// In proportion up to kLeastViews, then twice as many for each view.
int supported_iterations(int views) {
    const int counted = std::max(views, 2 * views - kLeastViews);
    return std::min(kSupportedLeast * counted / kLeastViews, kSupportedMost);
}

Decision decide_poses(const SceneLook& look, const CameraOptions& options) {
    const bool off = look.pose_error >= kPoseError;
    Decision decision{"cameras",
                      off ? "refined" : "kept",
                      "no observations of points to measure them",
                      look.pose_error,
                      kPoseError,
                      {{"cameras.refine", off ? "true" : "false"}},
                      off ? "cameras refined" : "cameras kept"};
    if (std::isnan(look.pose_error)) return decision;
    decision.reason = str("reprojection error ", short_figure(look.pose_error),
                          " px, refined from ", kPoseError, " px on");
    if (off || !options.refine) return decision;
    // The user refines poses whose points fit well: they hold a pose better than photographs do.
    const double loose = (look.pose_error - kPoseExact) / (kPoseError - kPoseExact);
    const double bound = std::max(1e-3, loose * double(options.bound_px));
    decision.reason += str("; they move by ", rounded(bound), " px at most");
    decision.settings.emplace_back("cameras.bound_px", rounded(bound));
    return decision;
}

Decision decide_exposure(const SceneLook& look) {
    const bool drifts = look.exposure_drift >= kDrift;
    return {"exposure",
            drifts ? "fitted" : "no correction",
            std::isnan(look.exposure_drift)
                ? "no two photographs near each other share enough points"
                : str("brightness differs by ", percent(look.exposure_drift),
                      " between photographs, fitted from ", percent(kDrift), " on"),
            look.exposure_drift,
            kDrift,
            {{"loss.photometric.exposure", drifts ? "true" : "false"}},
            drifts ? "exposure fitted" : ""};
}

/// The decisions of one training, in the order of RUN/plan.json.
class TrainingDecisions {
public:
    TrainingDecisions(const SceneLook& look, const TrainingInputs& in)
        : look_(look),
          in_(in),
          points_(look.points_per_pixel),
          covered_(in.dense ? 0 : covered_share(points_)) {}

    std::vector<Decision> all() {
        schedule();
        growth();
        rasteriser();
        if (covered_ > 0) {
            if (in_.supported) support();
            normals();
            meshed_splats();
            single_views();
        }
        mesh_resolution();
        if (covered_ > 0 && in_.options.tv.enabled) votes();
        if (in_.dense || covered_ > 0) multi_view();
        background();
        plan_.push_back(decide_poses(look_, in_.options.cameras));
        plan_.push_back(decide_exposure(look_));
        return std::move(plan_);
    }

private:
    /// Adds a decision that depends on the coverage.
    void by_cloud(const char* name, const std::string& choice, Settings settings) {
        plan_.push_back(
            {name, choice, coverage_text(points_), points_, kSparseCloud, std::move(settings)});
    }
    /// 0 up to kLeastViews, 1 from kFewViews on.
    double between_few_views() const {
        return std::clamp(double(look_.train_views - kLeastViews) / double(kFewViews - kLeastViews),
                          0.0, 1.0);
    }
    void by_views(const std::string& slope) {
        plan_.back().reason += str("; ", look_.train_views, " photographs: ", slope);
    }

    void schedule() {
        const int views = look_.train_views,
                  per_view = in_.supported ? kManyPerView : kIterationsPerView,
                  least = in_.supported ? supported_iterations(views) : kIterations,
                  enough = std::max(least, per_view * views);
        iterations_ = in_.wanted >= 0
                          ? in_.wanted
                          : between(in_.configured, std::min(enough, in_.configured), covered_);
        TrainOptions fitted = in_.options;
        fitted.iterations = in_.configured;
        fit_schedule(fitted, iterations_);
        normal_start_ = fitted.loss.normal.start;
        const Settings schedule = schedule_settings(in_.options, fitted);
        const std::string count = std::to_string(iterations_);
        if (in_.wanted >= 0)
            plan_.push_back({"iterations", count, "set by the user; the schedule fits them", kNone,
                             kNone, schedule});
        else if (in_.dense)
            plan_.push_back({"iterations", count, "of the preset", kNone, kNone, schedule});
        else
            by_cloud("iterations", count, schedule);
        if (in_.wanted < 0 && covered_ > 0)
            plan_.back().reason +=
                str("; at full coverage ", per_view, " per photograph, at least ", grouped(least));
    }

    void growth() {
        if (in_.dense) return;
        // A user who asks for growth where the plan has none gets full growth.
        if (covered_ >= 1)
            by_cloud("new splats", "none needed", {{"densify.enabled", "false"}});
        else
            by_cloud(
                "new splats", covered_ > 0 ? str("in gaps, ", percent(covered_), " fewer") : "yes",
                {{"densify.enabled", "true"}, {"densify.growth_in_gaps_only", rounded(covered_)}});
        plan_.back().brief = covered_ >= 1  ? "no new splats"
                             : covered_ > 0 ? "new splats in gaps"
                                            : "new splats";
    }

    void rasteriser() {
        if (in_.dense || !in_.discs || !(points_ >= kCloudForDiscs)) return;
        // Files keep three scales, for the viewers of 3DGS.
        plan_.push_back({"rasteriser",
                         "discs",
                         str(short_figure(points_), " start points per textured pixel, ",
                             kCloudForDiscs, " needed"),
                         points_,
                         kCloudForDiscs,
                         {{"backbone", kDiscs}, {"output.ply_scales", "three"}}});
    }

    /// Stereo knows the surface: splats start opaque on it. With few views the photometric gradient
    /// would move them away, so it acts late or not at all.
    void support() {
        // Photographs that are too far apart to compare are as few.
        const double many = look_.views_in_wide_pairs * between_few_views();
        const double opacity = double(in_.options.init.opacity);
        Settings settings{
            {"init.support", "true"},
            {"init.opacity", rounded(between(opacity, kOpaque, covered_))},
            {"init.gap_px", std::to_string(kGapPx)},
            {"lr.supported", rounded(std::pow(kFreeRates, between(1.0, many, covered_)))}};
        const int full = many > 0 ? int(std::lround(kRising * iterations_ / many)) : 0;
        // Gradients of cameras need all of it.
        const bool refines = look_.pose_error >= kPoseError || in_.options.cameras.refine;
        if (in_.parts_colors && !refines) {
            settings.emplace_back("loss.photometric.geometry", rounded(1 - covered_));
            settings.emplace_back("loss.photometric.geometry_full", std::to_string(full));
        }
        by_cloud("surface",
                 many > 0 ? str("photometric gradients rise to ",
                                percent(std::min(1.0, 1.0 * iterations_ / full)))
                          : "no photometric gradients",
                 std::move(settings));
        by_views(str("not at all up to ", kLeastViews, ", from ", percent(kRising),
                     " of the iterations on from ", kFewViews, " on; ",
                     percent(look_.views_in_wide_pairs), " have another within ", kWideAngleDeg,
                     " degrees"));
    }

    void normals() {
        const std::string start = std::to_string(between(normal_start_, 1, covered_));
        by_cloud("normal loss", str("from iteration ", start), {{"loss.normal.start", start}});
        if (!in_.normals || look_.train_views >= kManyViews) return;
        const double few = double(kManyViews - look_.train_views) / double(kManyViews - kFewViews);
        const std::string weight = rounded(covered_ * std::min(few, 1.0));
        by_cloud("prior normals", str("weight ", weight),
                 // Priors that lie beside a scene were not measured.
                 {{"loss.prior_normal.weight", weight}, {"priors.source", "stereo"}});
        by_views(str("full weight up to ", kFewViews, ", none from ", kManyViews, " on"));
    }

    /// A larger splat lies in a gap of the cloud, at a depth that nothing has measured.
    void meshed_splats() {
        const int views = in_.supported ? kLeastViews : look_.train_views;
        if (views >= kFewViews) return;
        const int least = kMeshedScalePx << std::max(0, views - kLeastViews);
        const std::string px = rounded(std::min(least / covered_, kLargestScalePx));
        by_cloud("meshed splats", str("up to ", px, " px"), {{"mesh.max_scale_px", px}});
        if (!in_.supported)
            by_views(str(kMeshedScalePx, " px up to ", kLeastViews,
                         ", twice that for each more, no limit from ", kFewViews, " on"));
    }

    /// With more views, surface that a single view sees is right more often, rough as it is.
    void single_views() {
        const double many = between_few_views();
        const double covered_px = kLeastJumpPx * std::pow(kManyJumpPx / kLeastJumpPx, many),
                     jump_px = kBareJumpPx * std::pow(covered_px / kBareJumpPx, covered_);
        by_cloud("single views", str("meshed if smooth to ", short_figure(jump_px), " px"),
                 {{"mesh.single_view_jump_px", rounded(jump_px)}});
        by_views(str(kLeastJumpPx, " px up to ", kLeastViews, ", ", kManyJumpPx, " px from ",
                     kFewViews, " on"));
    }

    void mesh_resolution() {
        for (const ByPixels& by : kByPixels) {
            if (!(look_.megapixels > by.few_megapixels)) continue;
            const double many = std::min(
                (look_.megapixels - by.few_megapixels) / (kManyMegapixels - by.few_megapixels),
                1.0);
            const std::string px = rounded(by.few_px + many * (by.many_px - by.few_px));
            plan_.push_back({by.decision,
                             str(px, " px"),
                             str(short_figure(look_.megapixels), " megapixels in all; ", by.few_px,
                                 " px up to ", by.few_megapixels, ", ", by.many_px, " from ",
                                 kManyMegapixels, " on"),
                             look_.megapixels,
                             by.few_megapixels,
                             {{by.key, px}}});
        }
    }

    void votes() {
        const TrainOptions& o = in_.options;
        const std::string every = std::to_string(between(o.tv.vote_every, kVoteEvery, covered_)),
                          search =
                              std::to_string(between(o.tv.refresh_every, kRefreshEvery, covered_)),
                          weight = rounded(between(double(o.loss.tv_position.weight),
                                                   kPositionWeight, covered_));
        const int views = look_.train_views;
        const double few = double(kViewsWithoutVotes - views) /
                           double(kViewsWithoutVotes - kLeastViews),
                     share = in_.supported ? between(1.0, std::clamp(few, 0.0, 1.0), covered_) : 1;
        Settings settings{{"tv.vote_every", every}};
        if (share < 1) {
            if (share <= 0) settings = {{"tv.enabled", "false"}};
            for (const auto& [key, configured] :
                 {std::pair{"loss.tv_normal.weight", o.loss.tv_normal.weight},
                  std::pair{"loss.tv_position.weight", o.loss.tv_position.weight}})
                settings.emplace_back(key, rounded(share * double(configured)));
        }
        by_cloud("votes",
                 share >= 1  ? str("every ", every)
                 : share > 0 ? str(percent(share), " of their weight, every ", every)
                             : "off",
                 std::move(settings));
        if (in_.supported)
            by_views(str("in full up to ", kLeastViews, ", none from ", kViewsWithoutVotes, " on"));
        if (share <= 0) return;
        if (!in_.supported)
            by_cloud("position loss", str("weight ", weight),
                     {{"loss.tv_position.weight", weight}});
        by_cloud("neighbours", str("every ", search), {{"tv.refresh_every", search}});
    }

    void multi_view() {
        const bool widest =
            in_.supported && look_.views_in_widest_pairs > look_.views_in_wide_pairs;
        const double angle{widest ? kWidestAngleDeg : kWideAngleDeg};
        const double share = widest ? look_.views_in_widest_pairs : look_.views_in_wide_pairs;
        const double weight = widest ? comparable(look_.pair_angle_deg) : 1;
        const bool on = share > 0;
        const double strength = !on ? 0 : weight * (in_.dense ? 1 : covered_);
        // Before the splats are opaque, the compared depths are means of near and far ones. They
        // need as many iterations in a longer training; a short one starts earlier.
        const int opaque = in_.supported ? 1 : kOpaqueAfter;
        const std::string start = std::to_string(std::clamp(iterations_ / kOpaqueShare, 1, opaque));
        Settings settings, starts;
        for (const TermOnList& term : terms_on_list(in_.multi_view)) {
            if (term.needs.neighbour_views == 0 || !(term.weight > 0)) continue;
            settings.emplace_back(str("loss.", term.key, ".weight"),
                                  rounded(strength * double(term.weight)));
            starts.emplace_back(str("loss.", term.key, ".start"), start);
        }
        settings.emplace_back("loss.multi_view.limits", "relative");
        settings.emplace_back("loss.multi_view.fallback_angle_deg", str(angle));
        if (on && !in_.dense) settings.insert(settings.end(), starts.begin(), starts.end());
        const std::string choice = on ? percent(strength) : "off",
                          pairs = str(percent(look_.views_in_pairs),
                                      " of the photographs have another within ",
                                      in_.options.loss.multi_view.max_angle_deg, " degrees, ",
                                      percent(share), " within ", angle,
                                      weight < 1 ? ", less weight from 45 degrees on" : "");
        if (in_.dense) {
            plan_.push_back({"multi-view", choice, pairs, share, 0, settings});
        } else {
            by_cloud("multi-view", choice, settings);
            plan_.back().reason += str("; ", pairs);
        }
        if (!on) plan_.back().brief = "photographs too far apart to compare";
    }

    /// Not with a sky, nor where masks leave out a part of the photographs.
    void background() {
        const MaskUse use = in_.options.loss.photometric.masks;
        const bool masked = use == MaskUse::object || (uses_masks(use) && look_.outside);
        const bool sky = in_.options.loss.photometric.background == "sky";
        if (masked || sky) return;
        if (in_.supported && !in_.dense) {
            plan_.push_back({"background",
                             "the photographs, blurred",
                             "stereo made the start points; nothing measures the depth elsewhere",
                             kNone,
                             kNone,
                             {{"loss.photometric.background", kSoftBackground}}});
            plan_.push_back(
                {"unseen places",
                 str(percent(kDropout), " of the splats left out, axes up to ", kLongestAxis,
                     " to 1"),
                 "stereo made the start points; views from elsewhere would show needles and gaps",
                 kNone,
                 kNone,
                 {{"loss.photometric.dropout", str(kDropout)},
                  {"model.longest_axis", str(kLongestAxis)}}});
            return;
        }
        if (!(look_.background_border > 0)) return;
        const bool one = look_.background_border >= kBackgroundBorder &&
                         look_.background_points < kBackgroundPoints;
        const std::string color =
            one ? str(look_.background[0], ",", look_.background[1], ",", look_.background[2])
                : "none";
        plan_.push_back(
            {"background",
             color,
             str("one colour on ", percent(look_.background_border), " of the borders, ",
                 percent(kBackgroundBorder), " needed; it has ", percent(look_.background_points),
                 " of the start points, less than ", percent(kBackgroundPoints), " allowed"),
             look_.background_border,
             kBackgroundBorder,
             {{"loss.photometric.background", color}}});
    }

    const SceneLook& look_;
    const TrainingInputs& in_;
    const double points_, covered_;  // per pixel; 0 to 1, see covered_share()
    int iterations_ = 0, normal_start_ = 0;
    std::vector<Decision> plan_;
};

}  // namespace

std::vector<Decision> decide_training(const SceneLook& look, const TrainingInputs& inputs) {
    return TrainingDecisions(look, inputs).all();
}

}  // namespace tvsgs
