#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "io/scene/load_views.h"

namespace tvsgs {
namespace {

constexpr int kLeast = 30;      // fewest observations to judge a view
constexpr double kOutlier = 3;  // times the median residual
constexpr int kUnknowns = 6;
constexpr double kContradiction = 0.05;  // widths of the photograph that no pose explains

/// Residual of an observation and its derivatives by the view's rotation and shift; px.
struct Residual {
    double e[2], by[2][kUnknowns];
};

std::optional<Residual> residual_at(const Intrinsics& in, Vec3d p, Vec2<float> seen) {
    Vec2<double> place;
    if (!(p.z > 0) || !std::isfinite(seen.x + seen.y) ||
        !find_in_photo(in, in.fx_px * p.x / p.z + in.cx_px, in.fy_px * p.y / p.z + in.cy_px, place))
        return std::nullopt;
    Residual r{{static_cast<double>(seen.x) - place.x, static_cast<double>(seen.y) - place.y}, {}};
    for (int k = 0; k < kUnknowns; ++k) {
        Vec3d e{};
        e[k % 3] = 1;
        // Neglects the change of the lens distortion. Shifts are in units of the point's depth.
        const Vec3d by = k < 3 ? cross(e, p) : p.z * e;
        r.by[0][k] = in.fx_px / p.z * (by.x - p.x / p.z * by.z);
        r.by[1][k] = in.fy_px / p.z * (by.y - p.y / p.z * by.z);
    }
    return r;
}

/// Root mean square in px of the points' shift by one least-squares step of the pose, after
/// subtraction of the part that the observations' noise explains. NaN: too few observations;
/// infinite: more than `most_px` remain.
double pose_error(std::vector<Residual>& residuals, double most_px) {
    const auto squared = [](const Residual& r) { return r.e[0] * r.e[0] + r.e[1] * r.e[1]; };
    if (residuals.empty()) return NAN;
    const auto middle = residuals.begin() + static_cast<std::ptrdiff_t>(residuals.size() / 2);
    std::nth_element(residuals.begin(), middle, residuals.end(),
                     [&](const Residual& a, const Residual& b) { return squared(a) < squared(b); });
    const double most = kOutlier * kOutlier * squared(*middle);
    std::erase_if(residuals, [&](const Residual& r) { return squared(r) > most; });
    const auto n = static_cast<double>(residuals.size());
    if (n < kLeast) return NAN;
    Eigen::Matrix<double, kUnknowns, kUnknowns> A = A.Zero();
    Eigen::Vector<double, kUnknowns> b = b.Zero();
    for (const Residual& r : residuals)
        for (const int row : {0, 1}) {
            const Eigen::Map<const Eigen::Vector<double, kUnknowns>> by(r.by[row]);
            A += by * by.transpose(), b += r.e[row] * by;
        }
    Eigen::CompleteOrthogonalDecomposition<decltype(A)> solver;
    solver.setThreshold(1e-9);  // unknowns that no observation determines stay 0
    const Eigen::Vector<double, kUnknowns> x = solver.compute(A).solve(b);
    double moved = 0, left = 0;
    for (const Residual& r : residuals)
        for (int row = 0; row < 2; ++row) {
            double step = 0;
            for (int i = 0; i < kUnknowns; ++i) step += r.by[row][i] * x[i];
            moved += step * step;
            left += (r.e[row] - step) * (r.e[row] - step);
        }
    if (left > n * most_px * most_px) return INFINITY;
    const double by_noise = kUnknowns * left / (2 * n - kUnknowns);
    return std::sqrt(std::max(0.0, (moved - by_noise) / n));
}

}  // namespace

void measure_pose_errors(const ColmapPoints& points,
                         const std::vector<ViewSource>& sources,
                         std::vector<View>& views) {
    std::map<std::uint32_t, std::size_t> view_of;
    for (std::size_t i = 0; i < sources.size(); ++i) view_of[sources[i].image->id] = i;
    struct Seen {
        std::uint32_t point, observation;
    };
    std::vector<std::vector<Seen>> seen_by(views.size());
    for (std::size_t p = 0; p < points.positions.size(); ++p)
        for (std::size_t j = points.track_begin[p]; j < points.track_begin[p + 1]; ++j) {
            const auto at = view_of.find(points.track[j]);
            if (at == view_of.end()) continue;
            const std::size_t seen = points.track_observation[j];
            // Some models have no observations.
            if (seen < sources[at->second].image->observations.size())
                seen_by[at->second].push_back(
                    {static_cast<std::uint32_t>(p), static_cast<std::uint32_t>(seen)});
        }
    std::vector<Residual> residuals;  // of one view at a time, to save memory
    for (std::size_t i = 0; i < views.size(); ++i) {
        const ColmapImage& image = *sources[i].image;
        residuals.clear();
        std::size_t behind = 0;
        for (const Seen& s : seen_by[i]) {
            const Vec3d p = image.camera_from_world * points.positions[s.point];
            behind += p.z <= 0;
            if (const auto r =
                    residual_at(sources[i].intrinsics, p, image.observations[s.observation]))
                residuals.push_back(*r);
        }
        const double most_px = kContradiction * sources[i].intrinsics.width_px;
        const double scale = double(views[i].camera.width_px) / sources[i].intrinsics.width_px;
        views[i].pose_error_px = behind >= kLeast && 2 * behind > seen_by[i].size()
                                     ? INFINITY
                                     : scale * pose_error(residuals, most_px);
    }
}

}  // namespace tvsgs
