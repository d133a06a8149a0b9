#include "plan/look.h"

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <optional>

#include "core/error.h"
#include "core/math/quantile.h"
#include "core/progress.h"
#include "core/scene/photo_light.h"
#include "mesh/fuse/focus.h"
#include "plan/figures.h"

namespace tvsgs {
namespace {

constexpr int kReach = 2, kSide = 2 * kReach + 1;
using Patch = std::array<double, kSide * kSide>;

/// Grey levels around the projection of a point, 0 to 255. Nothing where they leave the image.
std::optional<Patch> patch_at(const View& view, Vec3f point) {
    const Camera& c = view.camera;
    if (!is_in_view(c, point)) return std::nullopt;
    const Vec3f p = c.camera_from_world * point;
    const int x = int(c.fx_px * p.x / p.z + c.cx_px), y = int(c.fy_px * p.y / p.z + c.cy_px);
    if (x < kReach || y < kReach || x + kReach >= view.photo.width ||
        y + kReach >= view.photo.height)
        return std::nullopt;
    Patch patch;
    for (int i = 0; i < kSide * kSide; ++i) {
        const int at_x = x + i % kSide - kReach, at_y = y + i / kSide - kReach;
        patch[i] = (view.photo.at(at_x, at_y, 0) + view.photo.at(at_x, at_y, 1) +
                    view.photo.at(at_x, at_y, 2)) /
                   3.0;
    }
    return patch;
}

/// Logarithm of the ratio of two patches' brightness. Nothing for patches that differ, are flat,
/// dark or saturated. `light`: of the darker view.
std::optional<double> log_gain(const Patch& a, const Patch& b, const PhotoLight& light) {
    const auto mean = [](const Patch& p) {
        return std::accumulate(p.begin(), p.end(), 0.0) / double(p.size());
    };
    const double mean_a = mean(a), mean_b = mean(b);
    double aa = 0, bb = 0, ab = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        const double da = a[i] - mean_a, db = b[i] - mean_b;
        aa += da * da, bb += db * db, ab += da * db;
    }
    constexpr double kFlat = 2;  // grey levels of deviation in full light
    const double flat = kSide * kSide * std::pow(kFlat * light.factor(kFlat, 1), 2);
    const bool alike = std::min(aa, bb) > flat && ab > 0.8 * std::sqrt(aa * bb);
    if (!alike || std::min(mean_a, mean_b) < 10 * light.share || std::max(mean_a, mean_b) > 245)
        return std::nullopt;
    return std::log(mean_a / mean_b);
}

/// For every view the view whose optical axis is nearest, within 30 degrees; -1: none.
std::vector<int> nearest_views(const Scene& scene) {
    const int views = int(scene.train.size());
    std::vector<Vec3d> axes;
    for (const View& view : scene.train) axes.push_back(optical_axis(view.camera));
    const auto axis = [&](int v) { return axes[v]; };
    std::vector<int> nearest(scene.train.size(), -1);
    for (int v = 0; v < views; ++v) {
        double best = 0.866;  // 30 degrees
        for (int other = 0; other < views; ++other)
            if (const double cosine = dot(axis(v), axis(other)); other != v && cosine > best)
                best = cosine, nearest[v] = other;
    }
    return nearest;
}

/// See SceneLook::pair_angle_deg; 0 without pairs.
double pair_angle_deg(const Scene& scene, const ViewPairOptions& options) {
    std::vector<double> angles;
    const std::vector<std::vector<int>> pairs = select_view_pairs(scene, options, true).of_view;
    for (int v = 0; v < static_cast<int>(pairs.size()); ++v)
        if (!pairs[v].empty())
            angles.push_back(
                std::acos(std::clamp(dot(optical_axis(scene.train[v].camera),
                                         optical_axis(scene.train[pairs[v].front()].camera)),
                                     -1.0, 1.0)));
    return quantile(angles, 0.5) * 180 / M_PI;
}

/// The colour of the images' borders, see SceneLook.
struct BorderColor {
    int color[3] = {0, 0, 0};
    double share = 1;
    static constexpr int kNear = 8, kAlike = 12;  // grey levels: in a view, between views

    bool near(const View& view, int x, int y) const {
        for (int c = 0; c < 3; ++c)
            if (std::abs(view.photo.at(x, y, c) - color[c]) > kNear) return false;
        return true;
    }
};

/// Visits, from each pixel of the image's edge inwards, the first pixel that the lens saw.
template <class Visit>
void for_border(const View& view, const Visit& visit) {
    const int width = view.camera.width_px, height = view.camera.height_px;
    const auto inwards = [&](int x, int y, int dx, int dy) {
        const auto is_inside = [&] { return x >= 0 && y >= 0 && x < width && y < height; };
        while (is_inside() && !view.mask.empty() && view.mask.at(x, y) == kNoPhoto)
            x += dx, y += dy;
        if (is_inside()) visit(x, y);
    };
    for (int x = 0; x < width; ++x) inwards(x, 0, 0, 1), inwards(x, height - 1, 0, -1);
    for (int y = 0; y < height; ++y) inwards(0, y, 1, 0), inwards(width - 1, y, -1, 0);
}

/// Whether a mask leaves out pixels that the lens saw.
bool has_outside(const ImageU8& mask) {
    return std::ranges::find(mask.pixels, 0) != mask.pixels.end();
}

BorderColor border_color(const View& view) {
    BorderColor found;
    for (int c = 0; c < 3; ++c) {
        std::vector<double> levels;
        for_border(view, [&](int x, int y) { levels.push_back(view.photo.at(x, y, c)); });
        found.color[c] = levels.empty() ? 0 : int(lower_median(levels));
    }
    int all = 0, alike = 0;
    for_border(view, [&](int x, int y) { ++all, alike += found.near(view, x, y); });
    found.share = all > 0 ? double(alike) / all : 0;
    return found;
}

BorderColor border_color(const std::vector<View>& views) {
    std::vector<BorderColor> each;
    for (const View& view : views) each.push_back(border_color(view));
    BorderColor found;
    for (int c = 0; c < 3; ++c) {
        std::vector<double> levels;
        for (const BorderColor& of : each) levels.push_back(of.color[c]);
        found.color[c] = levels.empty() ? 0 : int(lower_median(levels));
    }
    for (const BorderColor& of : each) {
        found.share = std::min(found.share, of.share);
        for (int c = 0; c < 3; ++c)
            if (std::abs(of.color[c] - found.color[c]) > BorderColor::kAlike) found.share = 0;
    }
    return found;
}

}  // namespace

double comparable(double pair_angle_deg) {
    constexpr double kFull = 45, kNothing = kWidestAngleDeg;
    return std::clamp((kNothing - pair_angle_deg) / (kNothing - kFull), 0.0, 1.0);
}

SceneLook look_at(const Scene& scene,
                  const ViewPairOptions& limits,
                  bool masks,
                  const SkyDetection& sky) {
    const std::vector<Vec3f>& points = scene.points.positions;
    constexpr std::size_t kSample = 4000;  // points: a median to 1 or 2 %
    constexpr double kLeastShare = 0.01;
    const std::size_t stride = 1 + points.size() / kSample;
    const std::vector<int> nearest = nearest_views(scene);
    SceneLook look;
    look.train_views = int(scene.train.size());
    look.test_views = int(scene.test.size());
    look.points = points.size();
    std::vector<double> pose_errors;
    std::vector<PhotoLight> lights;
    for (const View& view : scene.train) {
        look.megapixels += 1e-6 * view.camera.width_px * view.camera.height_px;
        if (!std::isnan(view.pose_error_px)) pose_errors.push_back(view.pose_error_px);
        lights.push_back(measure_light(view.photo));
    }
    look.pose_error = lower_median(pose_errors);
    look.exposure_drift = std::numeric_limits<double>::quiet_NaN();
    look.outside =
        std::ranges::any_of(scene.train, [](const View& view) { return has_outside(view.mask); });
    const BorderColor border = border_color(scene.train);
    std::size_t sightings_in_all = 0, on_border_color = 0;
    std::vector<double> pixels, matchable, per_pixel, reductions;
    Progress progress("looking at the views", double(scene.train.size()));
    for (std::size_t v = 0; v < scene.train.size(); ++v) {
        progress.advance();
        const View& view = scene.train[v];
        const View* const other = nearest[v] < 0 ? nullptr : &scene.train[nearest[v]];
        const PhotoLight& light =
            other == nullptr ? lights[v]
                             : std::min(lights[v], lights[nearest[v]],
                                        [](auto& a, auto& b) { return a.share < b.share; });
        std::vector<double> gains;  // logarithms
        for (std::size_t i = 0; other != nullptr && i < points.size(); i += stride) {
            const auto here = patch_at(view, points[i]), there = patch_at(*other, points[i]);
            if (!here || !there) continue;
            if (const auto gain = log_gain(*here, *there, light)) gains.push_back(*gain);
        }
        const std::vector<Sighting> seen = sightings(view.camera, points, stride);
        const Matchable could_match(view, scene.train, masks, median_depth(seen),
                                    sky.views.empty() ? nullptr : &sky.views[v]);
        const double share = could_match.share();
        for (const Sighting& s : seen)
            ++sightings_in_all, on_border_color += border.near(view, s.x, s.y);
        // All pixels count in an image without texture.
        const bool some = share >= kLeastShare;
        const auto inside = std::ranges::count_if(
            seen, [&](const Sighting& s) { return !some || could_match.at(s.x, s.y); });
        matchable.push_back(some ? share : 1);
        pixels.push_back(matchable.back() * could_match.pixels());
        per_pixel.push_back(double(inside) * double(stride) / pixels.back());
        reductions.push_back(view.reduction);
        if (gains.size() < 30) continue;  // a median of fewer says little
        const double drift = std::abs(std::expm1(lower_median(gains)));
        look.exposure_drift =
            std::isnan(look.exposure_drift) ? drift : std::max(drift, look.exposure_drift);
    }
    std::copy(border.color, border.color + 3, look.background);
    look.background_border = border.share;
    look.background_points =
        sightings_in_all > 0 ? double(on_border_color) / double(sightings_in_all) : 0;
    look.pixels = lower_median(pixels);
    look.matchable = lower_median(matchable);
    look.points_per_pixel = lower_median(per_pixel);
    look.reduction = lower_median(reductions);
    ViewPairOptions relative = limits;
    relative.limits = PairLimits::relative;  // independent of the unit
    look.views_in_pairs = share_with_pair(scene, relative);
    relative.fallback_angle_deg = std::max(relative.fallback_angle_deg, kWideAngleDeg);
    look.views_in_wide_pairs = share_with_pair(scene, relative);
    relative.fallback_angle_deg = std::max(relative.fallback_angle_deg, kWidestAngleDeg);
    look.views_in_widest_pairs = share_with_pair(scene, relative);
    look.pair_angle_deg = pair_angle_deg(scene, relative);
    return look;
}

MaskLook look_at_masks(const std::vector<View>& train, const std::vector<Vec3f>& points) {
    MaskLook look;
    std::size_t seen = 0, seen_outside = 0;
    std::vector<double> borders;
    for (const View& view : train) {
        ++look.views;
        const ImageU8& mask = view.mask;
        if (mask.empty()) continue;
        ++look.masked;
        const auto object = [](std::uint8_t value) { return value >= kObjectMask; };
        if (std::ranges::none_of(mask.pixels, object) && look.empties++ == 0)
            look.empty = view.name;
        look.outside += has_outside(mask);
        int all = 0, outside = 0;
        for_border(view, [&](int x, int y) { ++all, outside += mask.at(x, y) == 0; });
        borders.push_back(all > 0 ? double(outside) / all : 0);
        for (const Sighting& s : sightings(view.camera, points, 1))
            ++seen, seen_outside += mask.at(s.x, s.y) == 0;
    }
    if (!borders.empty()) look.border = lower_median(borders);
    if (seen > 0) look.matched = double(seen_outside) / double(seen);
    return look;
}

StartLook look_at_start(const std::vector<View>& train,
                        const std::vector<Vec3f>& points,
                        bool masks) {
    constexpr int kCells = 64;
    const std::size_t stride = 1 + points.size() / 50000;  // enough for a few thousand cells
    std::size_t all = 0, covered = 0, tested = 0, behind = 0;
    for (const View& view : train) {
        for (std::size_t i = 0; i < points.size(); i += stride)
            ++tested, behind += (view.camera.camera_from_world * points[i]).z <= 0;
        const int w = view.camera.width_px, h = view.camera.height_px,
                  side = (std::max(w, h) + kCells - 1) / kCells, row = (w + side - 1) / side;
        std::vector<std::uint8_t> seen(std::size_t(row) * ((h + side - 1) / side));
        for (const Sighting& s : sightings(view.camera, points, stride))
            seen[std::size_t(s.y / side) * row + s.x / side] = 1;
        for (std::size_t i = 0; i < seen.size(); ++i) {
            const int x = std::min(int(i) % row * side + side / 2, w - 1),
                      y = std::min(int(i) / row * side + side / 2, h - 1);
            if (masks && !view.mask.empty() && view.mask.at(x, y) < kObjectMask) continue;
            ++all, covered += seen[i];
        }
    }
    return {points.size(), all > 0 ? double(covered) / double(all) : 0,
            tested > 0 ? double(behind) / double(tested) : 0};
}

double share_beyond(const std::vector<Camera>& cameras, const std::vector<Vec3f>& points) {
    const std::optional<Focus> focus = find_focus(cameras);
    if (!focus || !(focus->radius > 0)) return NAN;
    constexpr std::size_t kSample = 4000;
    const double limit = kDepthLimit * focus->radius;
    int seen = 0, beyond = 0;
    for (std::size_t i = 0; i < points.size(); i += 1 + points.size() / kSample) {
        int views = 0;
        bool far = true;
        for (const Camera& camera : cameras) {
            if (!is_in_view(camera, points[i])) continue;
            ++views;
            far = far && double((camera.camera_from_world * points[i]).z) >= limit;
        }
        if (views < 2) continue;
        ++seen, beyond += far;
    }
    return seen > 0 ? double(beyond) / seen : NAN;
}

CommonBall common_ball(const std::vector<Camera>& cameras, const std::vector<Vec3f>& points) {
    const std::optional<Focus> focus = find_focus(cameras);
    if (!focus) return {};
    CommonBall ball{common_radius(cameras, *focus), one_sidedness(cameras, *focus)};
    const auto inside = std::ranges::count_if(
        points, [&](Vec3f p) { return norm(vec_cast<double>(p) - focus->point) < ball.radius; });
    if (inside > 0) ball.points = double(inside) / double(points.size());
    return ball;
}

std::string coverage_text(double points_per_pixel) {
    const double covered = covered_share(points_per_pixel);
    return str(short_figure(points_per_pixel), " start points per textured pixel: ",
               covered >= 1  ? std::string("they cover the scene")
               : covered > 0 ? str(percent(covered), " of the way from ", kSparseCloud, " to the ",
                                   kCoveringCloud, " that cover the scene")
                             : str("too few (", kSparseCloud, " or more help)"));
}

}  // namespace tvsgs
