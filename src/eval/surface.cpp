#include "core/device/morton.h"
#include "core/device/parallel.h"
#include "core/math/point_tree.h"
#include "eval/mesh_metrics.h"

namespace tvsgs {
namespace {

/// Indices in Morton order: points close in space are close in memory, which dominates the time of
/// a search.
Buffer<int, Cpu> order_in_space(const Points& points) {
    std::vector<Vec3f> rounded;
    for (const Vec3d p : points) rounded.push_back(vec_cast<float>(p));
    Buffer<int, Cpu> order;
    morton_order({rounded.data(), rounded.size()}, order);
    return order;
}

Points in_order(const Points& points, const Buffer<int, Cpu>& order) {
    Points out;
    for (std::size_t i = 0; i < order.size(); ++i) out.push_back(points[order[i]]);
    return out;
}

template <class Point>
Points finite_points(const std::vector<Point>& points) {
    Points out;
    out.reserve(points.size());
    for (const Point& p : points)
        if (is_finite(p)) out.push_back(vec_cast<double>(p));
    return out;
}

}  // namespace

struct Surface::Cloud {
    Points points;  // ordered by order_in_space()
    PointTree<double, double> tree;

    explicit Cloud(const Points& all) : points(in_order(all, order_in_space(all))), tree(points) {}
    /// Returns null where there are no points.
    static std::shared_ptr<const Cloud> of(const Points& all) {
        return all.empty() ? nullptr : std::make_shared<Cloud>(all);
    }

    std::vector<double> distances(const Points& from, double limit) const {
        std::vector<double> out(from.size());
        parallel_for(Cpu{}, static_cast<int>(from.size()), [&](int i) {
            std::size_t index = 0;
            double squared = std::numeric_limits<double>::infinity();
            const bool near = tree.nearest_within(from[i], limit * limit, &index, &squared);
            out[i] = near ? std::sqrt(squared) : std::numeric_limits<double>::infinity();
        });
        return out;
    }
};

Surface::Surface(const TriangleMesh& mesh) : triangles_(mesh) {}
Surface::Surface(const std::vector<Vec3f>& points) : cloud_(Cloud::of(finite_points(points))) {}
Surface::Surface(const Points& points) : cloud_(Cloud::of(finite_points(points))) {}

std::vector<double> Surface::distances(const Points& points, double limit) const {
    const Buffer<int, Cpu> order = order_in_space(points);
    const Points from = in_order(points, order);
    const std::vector<double> near =
        cloud_ ? cloud_->distances(from, limit) : triangles_.distances(from, limit);
    std::vector<double> out(points.size());
    for (std::size_t i = 0; i < order.size(); ++i) out[order[i]] = near[i];
    return out;
}

SamplePoints all_points(const std::vector<Vec3f>& points) {
    return {finite_points(points), {}, 0};
}

std::vector<double> nearest_distances(const Points& points, const Points& targets) {
    return Surface(targets).distances(points);
}

}  // namespace tvsgs
