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

double median(std::vector<double>& values) {
    if (values.empty()) return kNone;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

/// Grey level around the place where a point projects, 0 to 255; NaN outside the view.
double grey_at(const View& view, Vec3f point) {
    const Camera& c = view.camera;
    const Vec3f p = c.camera_from_world * point;
    constexpr int kReach = 2;
    const int x = static_cast<int>(std::floor(c.fx_px * p.x / p.z + c.cx_px)),
              y = static_cast<int>(std::floor(c.fy_px * p.y / p.z + c.cy_px));
    if (x < kReach || y < kReach || x + kReach >= view.photo.width ||
        y + kReach >= view.photo.height)
        return kNone;
    int sum = 0;
    for (int dy = -kReach; dy <= kReach; ++dy)
        for (int dx = -kReach; dx <= kReach; ++dx)
            for (int k = 0; k < 3; ++k) sum += view.photo.at(x + dx, y + dy, k);
    constexpr int kCount = 3 * (2 * kReach + 1) * (2 * kReach + 1);
    return static_cast<double>(sum) / kCount;
}

/// For every view the one whose optical axis is nearest to its own, within 30 degrees; -1: none.
/// What such two see is hidden from few of either.
std::vector<int> nearest_views(const Scene& scene) {
    const int views = static_cast<int>(scene.train.size());
    const auto axis = [&](int v) {
        const Mat3f& R = scene.train[static_cast<std::size_t>(v)].camera.camera_from_world.R;
        return Vec3f{R[2][0], R[2][1], R[2][2]};
    };
    std::vector<int> nearest(scene.train.size(), -1);
    for (int v = 0; v < views; ++v) {
        float best = 0.866f;  // 30 degrees
        for (int other = 0; other < views; ++other)
            if (const float cosine = dot(axis(v), axis(other)); other != v && cosine > best)
                best = cosine, nearest[static_cast<std::size_t>(v)] = other;
    }
    return nearest;
}

/// What one point tells.
struct PointLook {
    std::vector<int> views;  // that it lies in
    double spread_deg = 0;   // the widest angle between two of them
};

PointLook look_at_point(const Scene& scene, Vec3f point) {
    PointLook look;
    std::vector<Vec3f> directions;
    for (int v = 0; v < static_cast<int>(scene.train.size()); ++v) {
        const Camera& camera = scene.train[static_cast<std::size_t>(v)].camera;
        if (!is_in_view(camera, point)) continue;
        look.views.push_back(v);
        directions.push_back(normalize(camera_centre(camera) - point));
    }
    float least = 1;
    for (std::size_t i = 0; i < directions.size(); ++i)
        for (std::size_t j = 0; j < i; ++j)
            least = std::min(least, dot(directions[i], directions[j]));
    look.spread_deg =
        std::acos(std::max(static_cast<double>(least), -1.0)) * 180 / 3.14159265358979;
    return look;
}

}  // namespace

SceneLook look_at(const Scene& scene, const NeighbourOptions& limits) {
    const std::vector<Vec3f>& points = scene.points.positions;
    constexpr std::size_t kSample = 4000;  // tells a median to a percent or two
    const std::size_t stride = 1 + points.size() / kSample;
    const std::size_t views = scene.train.size();
    std::vector<std::size_t> in_view(views, 0);
    std::vector<double> spreads;
    const std::vector<int> nearest = nearest_views(scene);
    std::vector<std::vector<double>> gains(views);  // logarithms, against the nearest view
    std::size_t pairs = 0, sampled = 0;
    for (std::size_t i = 0; i < points.size(); i += stride) {
        const PointLook point = look_at_point(scene, points[i]);
        ++sampled;
        for (const int v : point.views) ++in_view[static_cast<std::size_t>(v)];
        pairs += point.views.size();
        if (point.views.size() < 2) continue;
        spreads.push_back(point.spread_deg);
        for (const int v : point.views) {
            const std::size_t at = static_cast<std::size_t>(v);
            if (nearest[at] < 0) continue;
            const std::size_t other = static_cast<std::size_t>(nearest[at]);
            if (!is_in_view(scene.train[other].camera, points[i])) continue;
            const double grey = grey_at(scene.train[at], points[i]),
                         seen = grey_at(scene.train[other], points[i]);
            // Neither noise nor saturation tells an exposure.
            if (std::min(grey, seen) > 10 && std::max(grey, seen) < 245)
                gains[at].push_back(std::log(grey / seen));
        }
    }

    SceneLook look;
    look.views = static_cast<int>(views);
    look.points = points.size();
    std::vector<double> per_pixel;
    for (std::size_t v = 0; v < views; ++v) {
        const Camera& c = scene.train[v].camera;
        per_pixel.push_back(static_cast<double>(in_view[v] * stride) /
                            (static_cast<double>(c.width_px) * c.height_px));
    }
    look.points_per_pixel = median(per_pixel);
    look.views_per_point =
        sampled > 0 ? static_cast<double>(pairs) / static_cast<double>(sampled) : kNone;
    look.direction_spread_deg = median(spreads);
    NeighbourOptions relative = limits;
    relative.limits = NeighbourLimits::relative;  // these hold in any unit
    look.views_with_neighbour = share_with_neighbour(scene, relative);
    look.exposure_drift = kNone;
    for (auto& of_view : gains) {
        if (of_view.size() < 30) continue;  // a median of fewer says little
        const double drift = std::abs(std::expm1(median(of_view)));
        look.exposure_drift =
            std::isnan(look.exposure_drift) ? drift : std::max(drift, look.exposure_drift);
    }
    return look;
}

namespace {

constexpr int kDenseViews = 25;
bool is_dense(int views) {
    return views >= kDenseViews;
}
// Thresholds; docs/plan.md has the runs behind each.
constexpr double kCoveringCloud = 0.1;  // points per pixel
constexpr double kPaired = 0.5;         // share of the views
constexpr double kDrift = 0.15;
constexpr int kShort = 5000;  // iterations that a covering cloud needs

std::string number(double value, int digits = 3) {
    char text[32];
    std::snprintf(text, sizeof text, "%.*g", digits, value);
    return text;
}

/// "12 < 25".
std::string compared(double measured, double threshold, const char* unit = "") {
    return std::isnan(measured)
               ? str("not known")
               : str(number(measured), unit,
                     measured < threshold ? " < " : " >= ", number(threshold), unit);
}

/// The options' schedule, made for `configured` iterations, fitted to others, as settings.
Settings schedule_settings(const TrainOptions& options, int configured, int iterations) {
    TrainOptions fitted = options;
    fitted.iterations = configured;
    fit_schedule(fitted, iterations);
    Settings settings;
    visit_schedule(fitted, [&](const char* key, int value, Counts) {
        settings.emplace_back(key, std::to_string(value));
    });
    std::vector<int> before;
    visit_schedule(options, [&](const char*, int value, Counts) { before.push_back(value); });
    std::size_t next = 0;
    std::erase_if(settings, [&](const auto& setting) {
        return setting.second == std::to_string(before[next++]);
    });
    return settings;
}

}  // namespace

std::string summary(const SceneLook& look) {
    return str(look.views, " training views; ", look.points, " points, ",
               number(look.points_per_pixel), " per pixel, each in ", number(look.views_per_point),
               " views, their directions ", number(look.direction_spread_deg), " deg apart");
}

Decision plan_settings(int train_views) {
    const bool dense = is_dense(train_views);
    return {"settings",
            dense ? "dense" : "sparse",
            str("training views: ", compared(train_views, kDenseViews)),
            static_cast<double>(train_views),
            kDenseViews,
            "docs/plan.md, settings",
            {}};
}

std::vector<Decision> plan_cloud(const SceneLook& look, bool given) {
    if (given) return {{"initial cloud", "given", "scene.init_ply", kNone, kNone, "", {}}};
    if (is_dense(look.views)) return {};
    const bool enough = look.points_per_pixel >= kCoveringCloud;
    return {{"initial cloud",
             enough ? "the model's" : "stereo",
             str("points per pixel: ", compared(look.points_per_pixel, kCoveringCloud)),
             look.points_per_pixel,
             kCoveringCloud,
             "docs/plan.md, initial cloud",
             {{"init.min_points", enough ? "0" : "1000000000"}}}};
}

std::vector<Decision> plan_training(const SceneLook& look,
                                    const TrainOptions& options,
                                    int configured,
                                    int wanted) {
    std::vector<Decision> plan;
    const auto decide = [&](const char* name, bool yes, const std::string& choice,
                            const std::string& reason, double measured, double threshold,
                            const Settings& settings) {
        plan.push_back({name, choice, reason, measured, threshold, str("docs/plan.md, ", name),
                        yes ? settings : Settings{}});
    };
    const bool dense = is_dense(look.views);
    const bool covered = !dense && look.points_per_pixel >= kCoveringCloud;
    const std::string cloud =
        str("points per pixel: ", compared(look.points_per_pixel, kCoveringCloud));
    const int iterations = wanted > 0 ? wanted
                           : covered  ? std::min(kShort, configured)
                                      : configured;
    decide("iterations", true, std::to_string(iterations),
           wanted > 0 ? "as asked; the schedule fits them"
           : dense    ? "the dense settings'"
                      : cloud,
           look.points_per_pixel, kCoveringCloud,
           schedule_settings(options, configured, iterations));
    if (!dense) {
        decide("densify", covered, covered ? "off" : "on", cloud, look.points_per_pixel,
               kCoveringCloud, {{"densify.enabled", "false"}});
        decide("normal loss", covered, covered ? "from the start" : "as configured", cloud,
               look.points_per_pixel, kCoveringCloud, {{"loss.normal.start", "1"}});
        decide("votes", covered, covered ? "every 50 iterations" : "every 10 iterations", cloud,
               look.points_per_pixel, kCoveringCloud, {{"tv.vote_every", "50"}});
    }
    const bool neighbours = look.views_with_neighbour >= kPaired;
    const std::string share =
        str("views with a neighbour: ", compared(look.views_with_neighbour, kPaired));
    if (dense || covered)
        decide("multi-view", dense ? !neighbours : neighbours, neighbours ? "on" : "off", share,
               look.views_with_neighbour, kPaired,
               neighbours ? Settings{{"loss.multi_view_geometry.weight", "0.03"},
                                     {"loss.multi_view_ncc.weight", "0.15"},
                                     {"loss.multi_view_geometry.start", "1"},
                                     {"loss.multi_view_ncc.start", "1"},
                                     {"loss.multi_view.limits", "relative"}}
                          : Settings{{"loss.multi_view_geometry.weight", "0"},
                                     {"loss.multi_view_ncc.weight", "0"}});
    const bool drifts = look.exposure_drift >= kDrift;
    decide("exposure", drifts, drifts ? "fitted" : "off",
           std::isnan(look.exposure_drift)
               ? "no two views near each other share enough points"
               : str("brightness of a view at shared points, off by ",
                     compared(100 * look.exposure_drift, 100 * kDrift, " %")),
           look.exposure_drift, kDrift, {{"loss.photometric.exposure", "true"}});
    // A later decision has the last word on a key.
    for (std::size_t i = 0; i < plan.size(); ++i)
        std::erase_if(plan[i].settings, [&](const auto& setting) {
            return std::any_of(plan.begin() + static_cast<std::ptrdiff_t>(i) + 1, plan.end(),
                               [&](const Decision& later) {
                                   return std::any_of(later.settings.begin(), later.settings.end(),
                                                      [&](const auto& other) {
                                                          return other.first == setting.first;
                                                      });
                               });
        });
    return plan;
}

}  // namespace tvsgs
