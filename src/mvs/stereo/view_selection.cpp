#include "mvs/stereo/view_selection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/math/eigen.h"
#include "mvs/stereo/mvs_math.h"

namespace tvsgs {
namespace {

constexpr std::size_t kEnoughPoints = 20;  // in a view, for percentiles of their depths
constexpr double kDegree = 3.14159265358979 / 180;
constexpr double kFullPairAngleDeg = 45, kMaxPairAngleDeg = 75;
constexpr double kNearWeight = 0.5;     // of a pair at 60 degrees
constexpr std::size_t kFewSources = 2;  // with fewer near ones, farther ones help

/// The point nearest to all optical axes; none if they are parallel.
std::optional<Vec3d> common_focus(const std::vector<Camera>& cameras) {
    Sym3<double> A;
    Vec3d b;
    for (const Camera& camera : cameras) {
        const float* row = camera.camera_from_world.R[2];
        const Vec3d d = normalize(Vec3d{row[0], row[1], row[2]});
        const Vec3d c = vec_cast<double>(camera_centre(camera));
        A.xx += 1 - d.x * d.x, A.yy += 1 - d.y * d.y, A.zz += 1 - d.z * d.z;
        A.xy -= d.x * d.y, A.xz -= d.x * d.z, A.yz -= d.y * d.z;
        b += c - dot(d, c) * d;
    }
    const SymEigen3<double> eigen = sym_eigen(A);
    if (!(eigen.values.z > 1e-6 * eigen.values.x)) return std::nullopt;
    const Vec3d y = transpose_times(eigen.vectors, b);
    return eigen.vectors * Vec3d{y.x / eigen.values.x, y.y / eigen.values.y, y.z / eigen.values.z};
}

void set_range(const Camera& camera,
               const std::vector<Vec3f>& seen,
               const std::optional<Vec3d>& focus,
               ViewPlan& plan) {
    if (seen.size() >= kEnoughPoints) {
        std::vector<float> depths;
        for (const Vec3f p : seen) depths.push_back((camera.camera_from_world * p).z);
        std::ranges::sort(depths);
        plan.near_depth = 0.75f * depths[depths.size() / 100];
        plan.far_depth = 1.25f * depths[depths.size() - 1 - depths.size() / 100];
        return;
    }
    if (!focus) return;
    const float d = (camera.camera_from_world * vec_cast<float>(*focus)).z;
    if (d > 0) plan.near_depth = 0.3f * d, plan.far_depth = 3 * d;
}

/// Points that a view may see: a grid of pixels at three depths of the range.
std::vector<Vec3f> grid_points(const Camera& camera, const ViewPlan& plan) {
    constexpr int kGrid = 12;
    std::vector<Vec3f> points;
    for (const float share : {0.25f, 0.5f, 0.75f}) {
        const float depth = 1 / (share / plan.far_depth + (1 - share) / plan.near_depth);
        for (int j = 0; j < kGrid; ++j)
            for (int i = 0; i < kGrid; ++i) {
                const Vec3f ray = pixel_ray(camera, camera.width_px * (2 * i + 1) / (2 * kGrid),
                                            camera.height_px * (2 * j + 1) / (2 * kGrid));
                points.push_back(inverse(camera.camera_from_world) * (depth * ray));
            }
    }
    return points;
}

/// Weight of a pair of views at a mean angle: patches seen from farther apart match less often, and
/// not at all from kMaxPairAngleDeg on.
double pair_weight(double angle_deg) {
    const double beyond = (angle_deg - kFullPairAngleDeg) / (kMaxPairAngleDeg - kFullPairAngleDeg);
    return beyond <= 0 ? 1 : beyond >= 1 ? 0 : 0.5 * (1 + std::cos(180 * kDegree * beyond));
}

struct Score {
    double score, weight;
    int view;
};

/// Points that the camera sees, at most about 4,000: enough for ranges and scores.
std::vector<Vec3f> seen_points(const Camera& camera, const std::vector<Vec3f>& points) {
    const std::size_t stride = 1 + points.size() / 4000;
    std::vector<Vec3f> seen;
    for (std::size_t k = 0; k < points.size(); k += stride)
        if (is_in_view(camera, points[k])) seen.push_back(points[k]);
    return seen;
}

}  // namespace

std::vector<ViewPlan> plan_ranges(const std::vector<Camera>& cameras,
                                  const std::vector<Vec3f>& points,
                                  float near_depth,
                                  float far_depth) {
    const std::optional<Vec3d> focus = common_focus(cameras);
    std::vector<ViewPlan> plans(cameras.size());
    for (std::size_t i = 0; i < cameras.size(); ++i) {
        ViewPlan& plan = plans[i];
        const std::vector<Vec3f> seen = seen_points(cameras[i], points);
        set_range(cameras[i], seen, focus, plan);
        if (near_depth > 0) plan.near_depth = near_depth;
        if (far_depth > 0) plan.far_depth = far_depth;
        if (!(plan.near_depth > 0 && plan.far_depth > plan.near_depth))
            throw Error(ExitCode::input, "view ", i, ": unknown range of depths: it sees ",
                        seen.size(), " of ", grouped(points.size()), " sparse points (",
                        kEnoughPoints,
                        " needed), and no optical axes cross in front of it; give "
                        "stereo.depth_near and stereo.depth_far");
    }
    return plans;
}

std::vector<ViewPlan> plan_views(const std::vector<Camera>& cameras,
                                 const std::vector<Vec3f>& points,
                                 float near_depth,
                                 float far_depth) {
    std::vector<ViewPlan> plans = plan_ranges(cameras, points, near_depth, far_depth);
    std::size_t with_sources = 0;
    for (std::size_t i = 0; i < cameras.size(); ++i) {
        ViewPlan& plan = plans[i];
        std::vector<Vec3f> seen = seen_points(cameras[i], points);
        if (seen.size() < kEnoughPoints) seen = grid_points(cameras[i], plan);
        std::vector<Score> scores;
        const Vec3f own = camera_centre(cameras[i]);
        for (std::size_t j = 0; j < cameras.size(); ++j) {
            if (j == i) continue;
            const Vec3f other = camera_centre(cameras[j]);
            double score = 0, angle_sum = 0;
            int common = 0;
            for (const Vec3f p : seen) {
                if (!is_in_view(cameras[j], p)) continue;
                const float cosine = dot(normalize(p - own), normalize(p - other));
                const double angle =
                    std::acos(std::clamp(static_cast<double>(cosine), -1.0, 1.0)) / kDegree;
                const double spread = angle <= 5 ? 1 : 10;
                score += std::exp(-(angle - 5) * (angle - 5) / (2 * spread * spread));
                angle_sum += angle;
                ++common;
            }
            if (common == 0) continue;
            const double weight = pair_weight(angle_sum / common);
            if (weight * score > 0) scores.push_back({weight * score, weight, static_cast<int>(j)});
        }
        std::ranges::stable_sort(scores, std::ranges::greater(), &Score::score);
        // Beside near sources, far ones only add wrong matches.
        const auto near = static_cast<std::size_t>(
            std::ranges::count_if(scores, [](const Score& s) { return s.weight >= kNearWeight; }));
        if (near >= kFewSources)
            std::erase_if(scores, [](const Score& s) { return s.weight < kNearWeight; });
        const auto count = std::min(scores.size(), std::size_t{kMaxSources});
        for (std::size_t k = 0; k < count; ++k) {
            plan.sources.push_back(scores[k].view);
            plan.weights.push_back(static_cast<float>(scores[k].weight));
        }
        with_sources += count > 0;
    }
    if (with_sources == 0)
        throw Error(ExitCode::input, "none of the ", cameras.size(),
                    " views overlaps with another at less than ", kMaxPairAngleDeg,
                    " degrees; stereo needs overlapping views from different places");
    if (with_sources < cameras.size())
        spdlog::warn("{} of {} views overlap with no other view and get no depth",
                     cameras.size() - with_sources, cameras.size());
    return plans;
}

std::vector<VisiblePoint> visible_points(const Camera& camera, const std::vector<Vec3f>& points) {
    constexpr double kPerCell = 8, kBehind = 1.05, kSmallestCell = 2;
    std::vector<VisiblePoint> seen;
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (!is_in_view(camera, points[i])) continue;
        const Vec3d p = vec_cast<double>(camera.camera_from_world * points[i]);
        const double x = static_cast<double>(camera.fx_px) * p.x / p.z +
                         static_cast<double>(camera.cx_px),
                     y = static_cast<double>(camera.fy_px) * p.y / p.z +
                         static_cast<double>(camera.cy_px);
        seen.push_back({static_cast<int>(i), x, y, p.z, norm(p)});
    }
    const double pixels = static_cast<double>(camera.width_px) * camera.height_px;
    const double side = std::max(
        kSmallestCell, std::sqrt(kPerCell * pixels / static_cast<double>(seen.size() + 1)));
    const auto columns = static_cast<std::size_t>(camera.width_px / side) + 1,
               rows = static_cast<std::size_t>(camera.height_px / side) + 1;
    std::vector<double> nearest(columns * rows, std::numeric_limits<double>::infinity());
    const auto cell = [&](const VisiblePoint& p) -> double& {
        const auto column = std::min(static_cast<std::size_t>(p.x_px / side), columns - 1),
                   row = std::min(static_cast<std::size_t>(p.y_px / side), rows - 1);
        return nearest[row * columns + column];
    };
    for (const VisiblePoint& p : seen) cell(p) = std::min(cell(p), p.depth);
    std::erase_if(seen, [&](const VisiblePoint& p) { return p.depth > kBehind * cell(p); });
    return seen;
}

}  // namespace tvsgs
