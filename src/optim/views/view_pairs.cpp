#include "optim/views/view_pairs.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "core/log.h"
#include "optim/views/matchable.h"

namespace tvsgs {
namespace {

struct Candidate {
    double distance, angle_deg;  // distance in the unit of the limits
    int view;
};

bool is_nearer(const Candidate& a, const Candidate& b) {
    return std::tie(a.distance, a.angle_deg, a.view) < std::tie(b.distance, b.angle_deg, b.view);
}

struct Stand {
    Vec3d axis, centre;
};

/// Other views at a distance between `low` and `high`, nearest first, and the nearest of all other
/// views (view -1 if there is none).
struct Others {
    std::vector<Candidate> within;
    Candidate nearest{INFINITY, INFINITY, -1};

    Others(const std::vector<Stand>& stands, int i, double unit, double low, double high) {
        const Stand& own = stands[i];
        for (int j = 0; j < int(stands.size()); ++j) {
            if (j == i) continue;
            const Stand& other = stands[j];
            const double distance = norm(other.centre - own.centre) / unit;
            const bool candidate = distance > low && distance < high;
            if (!candidate && distance > nearest.distance) continue;
            // Without the clamp, as in the official code, acos(1 + eps) loses parallel cameras.
            const double cosine = std::clamp(dot(own.axis, other.axis), -1.0, 1.0);
            const Candidate c{distance, std::acos(cosine) * 180 / 3.14159265358979323846, j};
            if (candidate) within.push_back(c);
            if (nearest.view < 0 || is_nearer(c, nearest)) nearest = c;
        }
        std::ranges::sort(within, is_nearer);
    }
};

/// The pairs, and statistics of views without a pair for the log.
struct Found {
    ViewPairs result;
    int lonely = 0, without_depth = 0;
    double least_distance = 1e300, most_distance = 0, least_angle = 180, most_angle = 0;
};

Found find_view_pairs(const Scene& scene, const ViewPairOptions& options) {
    const bool relative = options.limits == PairLimits::relative;
    const double low = double(relative ? options.min_baseline : options.min_distance),
                 high = double(relative ? options.max_baseline : options.max_distance);
    Found found;
    ViewPairs& result = found.result;
    result.of_view.resize(scene.train.size());
    const std::vector<Vec3f>& points = scene.points.positions;
    std::vector<double> depths;
    for (const View& view : scene.train)
        depths.push_back(relative ? depth_of_view(view.camera, points, 1 + points.size() / 5000)
                                  : 1);  // enough points for a median

    std::vector<Stand> stands;
    for (const View& view : scene.train)
        stands.push_back({optical_axis(view.camera), vec_cast<double>(camera_centre(view.camera))});
    for (int i = 0; i < int(scene.train.size()); ++i) {
        const double unit = depths[i];
        std::vector<int>& chosen = result.of_view[i];
        if (!(unit > 0)) {
            ++found.lonely, ++found.without_depth;
            continue;
        }
        const Others others(stands, i, unit, low, high);
        const auto choose_within = [&](float angle_deg) {
            for (const Candidate& c : others.within)
                if (int(chosen.size()) < options.count && c.angle_deg < double(angle_deg))
                    chosen.push_back(c.view);
        };
        choose_within(options.max_angle_deg);
        if (chosen.empty()) choose_within(options.fallback_angle_deg);
        if (!chosen.empty()) continue;
        ++found.lonely;
        const Candidate& nearest = others.nearest;
        if (nearest.view < 0) continue;
        found.least_distance = std::min(found.least_distance, nearest.distance);
        found.most_distance = std::max(found.most_distance, nearest.distance);
        found.least_angle = std::min(found.least_angle, nearest.angle_deg);
        found.most_angle = std::max(found.most_angle, nearest.angle_deg);
    }
    if (relative) {
        // Officially 0.1, for depths of about 3.
        std::vector<double> known = depths;
        std::erase_if(known, [](double d) { return !(d > 0); });
        std::ranges::sort(known);
        result.min_depth = known.empty() ? 0 : float(known[known.size() / 2] / 30);
    }
    return found;
}

}  // namespace

double share_with_pair(const Scene& scene, const ViewPairOptions& options) {
    return 1 - find_view_pairs(scene, options).lonely / double(scene.train.size());
}

ViewPairs select_view_pairs(const Scene& scene, const ViewPairOptions& options, bool quiet) {
    const bool relative = options.limits == PairLimits::relative;
    const int views = int(scene.train.size());
    const Found found = find_view_pairs(scene, options);
    if (quiet) return found.result;
    const char* unit = relative ? "depths" : "world units";
    if (found.lonely == 0) {
        std::size_t pairs = 0;
        for (const auto& chosen : found.result.of_view) pairs += chosen.size();
        spdlog::debug("Each photograph is compared with {:.1f} others", double(pairs) / views);
    } else {
        spdlog::warn(
            "Multi-view losses are off for {} of {} training views: no other view within {:.4g} "
            "degrees and {:.4g} to {:.4g} {} (loss.multi_view.limits = {}){}{}",
            found.lonely, views,
            double(std::max(options.max_angle_deg, options.fallback_angle_deg)),
            double(relative ? options.min_baseline : options.min_distance),
            double(relative ? options.max_baseline : options.max_distance), unit,
            relative ? "relative" : "official",
            found.without_depth > 0 ? "; some see no start point, so their depth is unknown" : "",
            relative ? "" : "; for limits in depths set loss.multi_view.limits=relative");
        if (found.most_distance > 0)
            spdlog::warn(
                "The nearest other views of these views are {:.4g} to {:.4g} {} and {:.1f} to "
                "{:.1f} degrees away",
                found.least_distance, found.most_distance, unit, found.least_angle,
                found.most_angle);
    }
    return found.result;
}

}  // namespace tvsgs
