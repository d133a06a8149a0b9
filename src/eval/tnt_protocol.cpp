#include <algorithm>
#include <cmath>

#include "eval/mesh_metrics.h"
#include "eval/protocols.h"

namespace tvsgs {
namespace {

/// Every k-th point, so that about 4 million remain.
Points every_kth(Points points) {
    constexpr double kMost = 4e6;
    if (static_cast<double>(points.size()) <= kMost) return points;
    const auto k =
        static_cast<std::size_t>(std::nearbyint(static_cast<double>(points.size()) / kMost));
    Points out;
    for (std::size_t i = 0; i < points.size(); i += k) out.push_back(points[i]);
    return out;
}

MeasuredPoints measured(Points points, const Points& against) {
    MeasuredPoints out{std::move(points), {}, {}};
    out.statuses.assign(out.points.size(), PointStatus::measured);
    out.distances = nearest_distances(out.points, against);
    return out;
}

double share_below(const std::vector<double>& distances, double tau) {
    const auto n = std::ranges::count_if(distances, [&](double d) { return d < tau; });
    return static_cast<double>(n) / static_cast<double>(distances.size());
}

/// Cumulative histogram over the edges; the last bin includes its end, as in NumPy.
std::vector<double> curve(std::vector<double> distances, const std::vector<double>& edges) {
    std::ranges::sort(distances);
    std::vector<double> out;
    for (std::size_t i = 1; i < edges.size(); ++i) {
        const auto end = i + 1 < edges.size() ? std::ranges::lower_bound(distances, edges[i])
                                              : std::ranges::upper_bound(distances, edges[i]);
        out.push_back(static_cast<double>(end - distances.begin()) /
                      static_cast<double>(distances.size()));
    }
    return out;
}

}  // namespace

IcpRefinement refine_by_icp(const Points& prediction,
                            const Points& truth_cropped,
                            const Crop& crop,
                            const Affine3d& start,
                            double tau,
                            bool intended) {
    IcpRefinement out{start, {}};
    struct Stage {
        double voxel, max_distance;  // in tau; voxel 0: every k-th point
    };
    for (const Stage stage : {Stage{1, 80}, Stage{0.5, 20}, Stage{0, 2}}) {
        Points source = cropped(transformed(prediction, out.truth_from_prediction), crop);
        if (source.empty()) break;
        IcpOptions options;
        options.max_distance = stage.max_distance * tau;
        if (intended) options.max_iterations = 20, options.rmse_change = 1e-6;
        out.stages.push_back(
            stage.voxel > 0 ? icp(voxel_means(source, stage.voxel * tau),
                                  voxel_means(truth_cropped, stage.voxel * tau), options)
                            : icp(every_kth(std::move(source)), every_kth(truth_cropped), options));
        out.truth_from_prediction =
            out.stages.back().target_from_source * out.truth_from_prediction;
    }
    return out;
}

TntMetrics evaluate_tnt(
    const Points& prediction, const Points& truth, const Crop& crop, double tau, double voxel) {
    TntMetrics m;
    Points p = cropped(prediction, crop), t = cropped(truth, crop);
    m.prediction_cropped = static_cast<std::int64_t>(p.size());
    m.truth_cropped = static_cast<std::int64_t>(t.size());
    m.undefined = t.empty()   ? "no point of the truth is inside the crop volume"
                  : p.empty() ? "no point of the prediction is inside the crop volume"
                              : "";
    if (!m.undefined.empty()) return m;
    if (voxel > 0) p = voxel_means(p, voxel), t = voxel_means(t, voxel);
    m.prediction = measured(std::move(p), t);
    m.truth = measured(std::move(t), m.prediction.points);
    m.precision = share_below(m.prediction.distances, tau);
    m.recall = share_below(m.truth.distances, tau);
    const double sum = m.precision + m.recall;
    m.f1 = sum > 0 ? 2 * m.precision * m.recall / sum : 0;

    // numpy.arange(0, 5 tau, tau / 100)
    const double step = tau / 100;
    const auto count = static_cast<int>(std::ceil(5 * tau / step));
    for (int i = 0; i < count; ++i) m.edges.push_back(i * step);
    m.precision_curve = curve(m.prediction.distances, m.edges);
    m.recall_curve = curve(m.truth.distances, m.edges);
    return m;
}

}  // namespace tvsgs
