#include <algorithm>
#include <cmath>
#include <limits>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/grouped.h"
#include "eval/mesh_metrics.h"
#include "eval/protocols.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// The lattice of one face: n1 x n2 cells along its edges from the first corner.
struct Lattice {
    Vec3d origin, e1, e2;
    std::int64_t n1 = 0, n2 = 0;

    Lattice(const Points& vertices, Vec3i face, double spacing) {
        origin = vertices[face.x], e1 = vertices[face.y] - origin, e2 = vertices[face.z] - origin;
        const double l1 = norm(e1), l2 = norm(e2), twice_area = norm(cross(e1, e2));
        if (!(twice_area > 0 && std::isfinite(twice_area))) return;
        const double cell = spacing * std::sqrt(l1 * l2 / twice_area);
        constexpr double kMost = 1e9;  // larger counts fail anyway
        n1 = static_cast<std::int64_t>(std::min(std::floor(l1 / cell), kMost));
        n2 = static_cast<std::int64_t>(std::min(std::floor(l2 / cell), kMost));
        if (n1 == 0 || n2 == 0) n1 = n2 = 0;
    }
    /// Calls visit(point) for the lattice points inside the face. The last row and column lie
    /// outside, as in the official code.
    template <class Visit>
    void for_each(const Visit& visit) const {
        if (n1 == 0) return;
        for (std::int64_t i = 0; i <= n1; ++i)
            for (std::int64_t j = 0; j <= n2; ++j) {
                const double s = (static_cast<double>(i) + 0.5) / static_cast<double>(n1),
                             t = (static_cast<double>(j) + 0.5) / static_cast<double>(n2);
                if (!(s + t < 1)) break;
                visit(origin + s * e1 + t * e2);
            }
    }
};

bool in_box(const ObservationMask& mask, double patch, Vec3d p) {
    for (int a = 0; a < 3; ++a)
        if (!(p[a] >= mask.lower[a] - patch && p[a] < mask.upper[a] + 2 * patch)) return false;
    return true;
}

bool is_observed(const ObservationMask& mask, Vec3d p) {
    const int size[3] = {mask.nx, mask.ny, mask.nz};
    std::size_t index = 0;
    for (int a = 2; a >= 0; --a) {
        const double cell = std::nearbyint((p[a] - mask.lower[a]) / mask.voxel);  // half to even
        if (!(cell >= 0 && cell < size[a])) return false;
        index = index * size[a] + static_cast<std::size_t>(cell);
    }
    return mask.seen[index] != 0;
}

struct Summary {
    double mean = kNaN, median = kNaN;
    std::int64_t outliers = 0;
};

/// Stores the distances of the points that are not excluded, and returns their statistics.
Summary summarise(const std::vector<double>& distances, double limit, MeasuredPoints& points) {
    std::vector<double> inliers;
    std::size_t next = 0;
    Summary summary;
    for (std::size_t i = 0; i < points.points.size(); ++i) {
        if (points.statuses[i] == PointStatus::excluded) continue;
        const double d = distances[next++];
        points.distances[i] = d;
        if (d < limit)
            inliers.push_back(d);
        else
            points.statuses[i] = PointStatus::outlier, ++summary.outliers;
    }
    if (inliers.empty()) return summary;
    double partial[kSumBlocks] = {}, sum = 0;
    const double* const values = inliers.data();
    add_sum(
        Cpu{}, static_cast<int>(inliers.size()), [=](int i) { return values[i]; },
        1 / static_cast<double>(inliers.size()), {partial, kSumBlocks}, &sum);
    summary.mean = sum;
    summary.median = median_of(std::move(inliers));
    return summary;
}

Points selected(const MeasuredPoints& from) {
    Points out;
    for (std::size_t i = 0; i < from.points.size(); ++i)
        if (from.statuses[i] == PointStatus::measured) out.push_back(from.points[i]);
    return out;
}

MeasuredPoints unmeasured(Points points) {
    const std::size_t count = points.size();
    return {std::move(points), std::vector<double>(count, kNaN),
            std::vector<PointStatus>(count, PointStatus::measured)};
}

}  // namespace

Points sample_dtu(const Points& vertices,
                  const std::vector<Vec3i>& faces,
                  const DtuOptions& options) {
    // 1. Estimate the number of points (half of each lattice's cells) before allocating: background
    // triangles of a wrong scale would need billions.
    double expected = static_cast<double>(vertices.size());
    for (const Vec3i face : faces) {
        const Lattice lattice(vertices, face, options.spacing);
        expected += 0.5 * static_cast<double>(lattice.n1) * static_cast<double>(lattice.n2);
    }
    if (expected > static_cast<double>(options.max_samples))
        throw input_error("E_DTU_SAMPLES: samples every ", options.spacing,
                          " mm of the mesh are about ",
                          grouped(std::llround(std::min(expected, 9e18))), " points (limit ",
                          grouped(options.max_samples),
                          "); cut the background away (--cull-masks), check the "
                          "units (--mesh-units), or raise --max-samples");

    // 2. Each face writes to its own range.
    std::vector<std::int64_t> begin(faces.size() + 1, static_cast<std::int64_t>(vertices.size()));
    parallel_for(Cpu{}, static_cast<int>(faces.size()), [&](int f) {
        std::int64_t count = 0;
        Lattice(vertices, faces[f], options.spacing).for_each([&](Vec3d) { ++count; });
        begin[f + 1] = count;
    });
    for (std::size_t f = 0; f < faces.size(); ++f) begin[f + 1] += begin[f];
    Points samples(static_cast<std::size_t>(begin.back()));
    std::ranges::copy(vertices, samples.begin());
    parallel_for(Cpu{}, static_cast<int>(faces.size()), [&](int f) {
        auto at = samples.begin() + begin[f];
        Lattice(vertices, faces[f], options.spacing).for_each([&](Vec3d p) { *at++ = p; });
    });
    return samples;
}

DtuMetrics evaluate_dtu(const Points& samples, const DtuTruth& truth, const DtuOptions& options) {
    DtuMetrics m;
    m.accuracy = m.completeness = m.overall = m.accuracy_median = m.completeness_median = kNaN;
    m.sampled = static_cast<std::int64_t>(samples.size());

    // 1. The prediction: thinned, in the box, observed.
    Points thinned;
    for (const std::uint32_t i : thin_points(samples, options.spacing, options.seed))
        thinned.push_back(samples[i]);
    m.thinned = static_cast<std::int64_t>(thinned.size());
    m.prediction = unmeasured(std::move(thinned));
    Points inside;  // the truth is compared with these, observed or not
    for (std::size_t i = 0; i < m.prediction.points.size(); ++i) {
        const Vec3d p = m.prediction.points[i];
        const bool in = !truth.mask || in_box(*truth.mask, options.patch, p);
        if (in) inside.push_back(p);
        if (!in || (truth.mask && !is_observed(*truth.mask, p)))
            m.prediction.statuses[i] = PointStatus::excluded;
    }
    const Points observed = selected(m.prediction);
    m.in_box = static_cast<std::int64_t>(inside.size());
    m.observed = static_cast<std::int64_t>(observed.size());

    // 2. The truth: above the plane.
    m.truth = static_cast<std::int64_t>(truth.points.size());
    m.reference = unmeasured(truth.points);
    if (truth.plane) {
        const auto [a, b, c, d] = *truth.plane;
        for (std::size_t i = 0; i < truth.points.size(); ++i)
            if (!(dot(Vec3d{a, b, c}, truth.points[i]) + d > 0))
                m.reference.statuses[i] = PointStatus::excluded;
    }
    const Points above = selected(m.reference);
    m.truth_above = static_cast<std::int64_t>(above.size());
    m.undefined = m.sampled == 0  ? "the prediction has no points"
                  : m.in_box == 0 ? "no point of the prediction is inside the mask's box"
                  : m.observed == 0
                      ? "no point of the prediction is where the mask observes the scene"
                  : truth.points.empty() ? "the truth has no points"
                  : m.truth_above == 0   ? "no point of the truth is above the plane"
                                         : "";
    if (!m.undefined.empty()) return m;

    // 3. Distances: from the observed prediction to the whole truth, and from the truth above the
    // plane to the whole prediction in the box.
    const Summary accuracy =
        summarise(nearest_distances(observed, truth.points), options.max_distance, m.prediction);
    const Summary completeness =
        summarise(nearest_distances(above, inside), options.max_distance, m.reference);
    m.accuracy = accuracy.mean, m.accuracy_median = accuracy.median;
    m.completeness = completeness.mean, m.completeness_median = completeness.median;
    m.accuracy_outliers = accuracy.outliers, m.completeness_outliers = completeness.outliers;
    m.overall = 0.5 * (m.accuracy + m.completeness);
    if (!std::isfinite(m.overall))
        m.undefined = str("all distances are ", options.max_distance, " mm or more");
    return m;
}

}  // namespace tvsgs
