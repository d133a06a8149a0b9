#include "mesh/mesh_metrics.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "core/error.h"
#include "core/parallel.h"
#include "core/point_tree.h"
#include "core/rng.h"

namespace tvsgs {
namespace {

double mean(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

/// Indices by place, along a Morton curve of 2^10 cells a side: neighbours in space become
/// neighbours in memory, which is most of the time of a search.
template <class Real>
std::vector<std::uint32_t> order_in_space(const std::vector<Vec3<Real>>& points) {
    Vec3<Real> lower = points[0], upper = points[0];
    for (const auto& p : points)
        for (int a = 0; a < 3; ++a)
            lower[a] = std::min(lower[a], p[a]), upper[a] = std::max(upper[a], p[a]);
    const auto spread = [](std::uint64_t x) {  // two zeros before each of ten bits
        x = (x | x << 16) & 0x30000FF;
        x = (x | x << 8) & 0x300F00F;
        x = (x | x << 4) & 0x30C30C3;
        return (x | x << 2) & 0x9249249;
    };
    std::vector<std::uint64_t> keys(points.size());
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) {
        const auto at = static_cast<std::size_t>(i);
        std::uint64_t key = 0;
        for (int a = 0; a < 3; ++a) {
            const double size = static_cast<double>(upper[a]) - lower[a];
            const double place = size > 0 ? 1023 * ((points[at][a] - lower[a]) / size) : 0;
            key |= spread(place > 0 ? static_cast<std::uint64_t>(place) : 0) << a;  // NaN is 0
        }
        keys[at] = key << 32 | static_cast<std::uint32_t>(i);
    });
    std::sort(keys.begin(), keys.end());
    std::vector<std::uint32_t> order(points.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<std::uint32_t>(keys[i]);
    return order;
}

template <class Real>
std::vector<double> nearest(const std::vector<Vec3<Real>>& points,
                            const std::vector<Vec3<Real>>& targets) {
    std::vector<double> distances(points.size());
    if (points.empty()) return distances;
    std::vector<Vec3<Real>> sorted;
    sorted.reserve(targets.size());
    for (const std::uint32_t i : order_in_space(targets)) sorted.push_back(targets[i]);
    const PointTree<double, Real> tree(sorted);
    const std::vector<std::uint32_t> order = order_in_space(points);
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) {
        const std::size_t at = order[static_cast<std::size_t>(i)];
        std::size_t index = 0;
        double squared = std::numeric_limits<double>::infinity();
        tree.nearest(points[at], 1, &index, &squared);
        distances[at] = std::sqrt(squared);
    });
    return distances;
}

/// Fraction of the distances strictly below tau.
double fraction_below(const std::vector<double>& distances, double tau) {
    const auto n =
        std::count_if(distances.begin(), distances.end(), [&](double d) { return d < tau; });
    return static_cast<double>(n) / static_cast<double>(distances.size());
}

}  // namespace

std::vector<Vec3f> sample_surface(const TriangleMesh& mesh, std::size_t count, std::uint64_t seed) {
    const int vertices = static_cast<int>(mesh.vertices.size());
    std::vector<double> area_before(mesh.faces.size() + 1, 0.0);
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
        const Vec3i face = mesh.faces[f];
        for (int k = 0; k < 3; ++k)
            if (face[k] < 0 || face[k] >= vertices)
                throw Error(ExitCode::input, str("face ", f, " refers to vertex ", face[k],
                                                 ", but the mesh has ", vertices));
        const Vec3d a = vec_cast<double>(mesh.vertices[face.x]),
                    b = vec_cast<double>(mesh.vertices[face.y]),
                    c = vec_cast<double>(mesh.vertices[face.z]);
        const double area = 0.5 * norm(cross(b - a, c - a));
        area_before[f + 1] = area_before[f] + (area > 0 && std::isfinite(area) ? area : 0);
    }
    const double total = area_before.back();
    if (!(total > 0))
        throw Error(ExitCode::input, str("the mesh has no surface to sample: ", mesh.faces.size(),
                                         " faces with a total area of 0"));

    std::vector<Vec3f> samples(count);
    parallel_for(Cpu{}, static_cast<int>(count), [&](int i) {
        const Random4 random = random4(seed, RandomStream::sampling, static_cast<std::uint64_t>(i));
        const double at =
            (i + static_cast<double>(uniform(random.v[0]))) / static_cast<double>(count) * total;
        // The face whose share of the area `at` falls into; rounding at the very end stays on the
        // last one with area.
        auto next = std::upper_bound(area_before.begin(), area_before.end(), at);
        if (next == area_before.end())
            next = std::lower_bound(area_before.begin(), area_before.end(), total);
        const Vec3i face = mesh.faces[static_cast<std::size_t>(next - area_before.begin()) - 1];
        const float s = std::sqrt(uniform(random.v[1])), t = uniform(random.v[2]);
        samples[i] = (1 - s) * mesh.vertices[face.x] + (s * (1 - t)) * mesh.vertices[face.y] +
                     (s * t) * mesh.vertices[face.z];
    });
    return samples;
}

std::vector<double> nearest_distances(const std::vector<Vec3f>& points,
                                      const std::vector<Vec3f>& targets) {
    return nearest(points, targets);
}

std::vector<double> nearest_distances(const std::vector<Vec3d>& points,
                                      const std::vector<Vec3d>& targets) {
    return nearest(points, targets);
}

double median_of(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    if (values.size() % 2 == 1) return *middle;
    return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

GeometryMetrics evaluate_geometry(const std::vector<Vec3f>& prediction,
                                  const std::vector<Vec3f>& truth,
                                  const std::vector<Vec3f>& visible_truth,
                                  const GeometryOptions& options) {
    if (prediction.empty() || truth.empty())
        throw Error(
            ExitCode::input,
            str("nothing to compare: ", prediction.size(), " points of the prediction and ",
                truth.size(), " of the truth are inside of the crop; both need at least one"));
    std::vector<double> to_truth = nearest_distances(prediction, truth);
    std::vector<double> to_prediction =
        nearest_distances(visible_truth.empty() ? truth : visible_truth, prediction);

    GeometryMetrics metrics{};
    for (const double tau : options.taus) {
        const double precision = fraction_below(to_truth, tau),
                     recall = fraction_below(to_prediction, tau);
        const double sum = precision + recall;
        metrics.thresholds.push_back(
            {tau, precision, recall, sum > 0 ? 2 * precision * recall / sum : 0});
    }
    if (options.max_distance > 0)
        for (std::vector<double>* distances : {&to_truth, &to_prediction})
            for (double& d : *distances) d = std::min(d, options.max_distance);
    metrics.accuracy = mean(to_truth);
    metrics.completeness = mean(to_prediction);
    metrics.chamfer = 0.5 * (metrics.accuracy + metrics.completeness);
    metrics.median_accuracy = median_of(std::move(to_truth));
    metrics.median_completeness = median_of(std::move(to_prediction));
    return metrics;
}

}  // namespace tvsgs
