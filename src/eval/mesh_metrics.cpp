#include "eval/mesh_metrics.h"

#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/grouped.h"
#include "core/math/rng.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

/// Mean of the values measured from a sample's points, with the standard error from the variance
/// between draws.
struct Mean {
    double value, standard_error;
};
template <class Measure>
Mean mean_of(const SamplePoints& sample, const Measure& measure) {
    const std::size_t count = sample.points.size();
    double sum = 0;
    for (std::size_t i = 0; i < count; ++i) sum += measure(i);
    const double mean = sum / static_cast<double>(count);
    double squares = 0;
    for (std::size_t d = 0; d < sample.draws.size(); ++d) {
        const std::size_t end = d + 1 < sample.draws.size() ? sample.draws[d + 1] : count;
        double off = 0;
        for (std::size_t i = sample.draws[d]; i < end; ++i) off += measure(i) - mean;
        squares += off * off;
    }
    return {mean, std::sqrt(squares) / static_cast<double>(count)};
}

}  // namespace

std::vector<Vec3f> sample_surface(const TriangleMesh& mesh, std::size_t count, std::uint64_t seed) {
    const int vertices = static_cast<int>(mesh.vertices.size());
    std::vector<double> area_before(mesh.faces.size() + 1, 0.0);
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
        const Vec3i face = mesh.faces[f];
        for (int k = 0; k < 3; ++k)
            if (face[k] < 0 || face[k] >= vertices)
                throw input_error("face ", f, " refers to vertex ", face[k], " of ", vertices);
        const Vec3d a = vec_cast<double>(mesh.vertices[face.x]),
                    b = vec_cast<double>(mesh.vertices[face.y]),
                    c = vec_cast<double>(mesh.vertices[face.z]);
        const double area = 0.5 * norm(cross(b - a, c - a));
        area_before[f + 1] = area_before[f] + (area > 0 && std::isfinite(area) ? area : 0);
    }
    const double total = area_before.back();
    if (!(total > 0))
        throw input_error("the mesh has no area: ", grouped(mesh.faces.size()), " faces of area 0");

    std::vector<Vec3f> samples(count);
    parallel_for(Cpu{}, static_cast<int>(count), [&](int i) {
        const Random4 random = random4(seed, RandomStream::sampling, static_cast<std::uint64_t>(i));
        const double at =
            (i + static_cast<double>(uniform(random.v[0]))) / static_cast<double>(count) * total;
        // The face that contains the share `at` of the area. Rounding at the end selects the last
        // face with area.
        auto next = std::ranges::upper_bound(area_before, at);
        if (next == area_before.end()) next = std::ranges::lower_bound(area_before, total);
        const Vec3i face = mesh.faces[static_cast<std::size_t>(next - area_before.begin()) - 1];
        const float s = std::sqrt(uniform(random.v[1])), t = uniform(random.v[2]);
        samples[i] = (1 - s) * mesh.vertices[face.x] + (s * (1 - t)) * mesh.vertices[face.y] +
                     (s * t) * mesh.vertices[face.z];
    });
    return samples;
}

double median_of(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    if (values.size() % 2 == 1) return *middle;
    return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

GeometryMetrics evaluate_geometry(const MeasuredSurface& prediction,
                                  const MeasuredSurface& truth,
                                  const SamplePoints* wanted_truth,
                                  const GeometryOptions& options) {
    if (prediction.from.points.empty() || truth.from.points.empty())
        throw input_error(
            "nothing to compare inside the crop: ", grouped(prediction.from.points.size()),
            " points of the prediction and ", grouped(truth.from.points.size()),
            " of the truth; both need at least one");
    const SamplePoints& wanted = wanted_truth ? *wanted_truth : truth.from;
    if (wanted.points.empty())
        throw Error(
            ExitCode::input,
            "nothing to compare: the visible part of the truth (--visible-gt) has no points");
    double limit = std::numeric_limits<double>::infinity();
    if (options.max_distance > 0) {
        limit = options.max_distance;
        for (const double tau : options.taus) limit = std::max(limit, tau);
    }
    std::vector<double> to_truth = truth.to.distances(prediction.from.points, limit),
                        to_prediction = prediction.to.distances(wanted.points, limit);

    GeometryMetrics metrics{};
    for (const double tau : options.taus) {
        const auto share_below = [tau](const SamplePoints& from, const std::vector<double>& d) {
            return mean_of(from, [&](std::size_t i) { return d[i] < tau ? 1.0 : 0.0; });
        };
        const Mean precision = share_below(prediction.from, to_truth),
                   recall = share_below(wanted, to_prediction);
        const double p = precision.value, r = recall.value, sum = p + r;
        const double dp = precision.standard_error, dr = recall.standard_error;
        metrics.thresholds.push_back(
            {tau, p, r, sum > 0 ? 2 * p * r / sum : 0, dp, dr,
             sum > 0 ? 2 * std::hypot(r * r * dp, p * p * dr) / (sum * sum) : 0});
    }
    if (options.max_distance > 0)
        for (std::vector<double>* distances : {&to_truth, &to_prediction})
            for (double& d : *distances) d = std::min(d, options.max_distance);
    const Mean accuracy = mean_of(prediction.from, [&](std::size_t i) { return to_truth[i]; }),
               completeness = mean_of(wanted, [&](std::size_t i) { return to_prediction[i]; });
    metrics.accuracy = accuracy.value, metrics.accuracy_se = accuracy.standard_error;
    metrics.completeness = completeness.value;
    metrics.completeness_se = completeness.standard_error;
    metrics.chamfer = 0.5 * (metrics.accuracy + metrics.completeness);
    metrics.median_accuracy = median_of(std::move(to_truth));
    metrics.median_completeness = median_of(std::move(to_prediction));
    return metrics;
}

}  // namespace tvsgs
