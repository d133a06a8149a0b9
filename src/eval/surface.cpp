#include "eval/surface.h"

#include <algorithm>

#include "core/device/parallel.h"
#include "core/math/point_tree.h"

namespace tvsgs {
namespace {

/// Indices ordered along a Morton curve of 2^10 cells a side: points close in space are close in
/// memory, which dominates the time of a search.
std::vector<std::uint32_t> order_in_space(const std::vector<Vec3d>& points) {
    if (points.empty()) return {};
    Vec3d lower = points[0], upper = points[0];
    for (const auto& p : points)
        for (int a = 0; a < 3; ++a)
            lower[a] = std::min(lower[a], p[a]), upper[a] = std::max(upper[a], p[a]);
    const auto spread = [](std::uint64_t x) {  // inserts two zero bits before each of ten bits
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
            const double size = upper[a] - lower[a];
            const double place = size > 0 ? 1023 * ((points[at][a] - lower[a]) / size) : 0;
            key |= spread(place > 0 ? static_cast<std::uint64_t>(place) : 0) << a;  // NaN becomes 0
        }
        keys[at] = key << 32 | static_cast<std::uint32_t>(i);
    });
    std::sort(keys.begin(), keys.end());
    std::vector<std::uint32_t> order(points.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<std::uint32_t>(keys[i]);
    return order;
}

std::vector<Vec3d> in_order(const std::vector<Vec3d>& points,
                            const std::vector<std::uint32_t>& order) {
    std::vector<Vec3d> out;
    out.reserve(order.size());
    for (const std::uint32_t i : order) out.push_back(points[i]);
    return out;
}

template <class Point>
std::vector<Vec3d> finite_points(const std::vector<Point>& points) {
    std::vector<Vec3d> out;
    out.reserve(points.size());
    for (const Point& p : points)
        if (is_finite(p)) out.push_back(vec_cast<double>(p));
    return out;
}

}  // namespace

struct Surface::Cloud {
    std::vector<Vec3d> points;  // ordered by order_in_space()
    PointTree<double, double> tree;

    explicit Cloud(const std::vector<Vec3d>& all)
        : points(in_order(all, order_in_space(all))), tree(points) {}
    /// Returns null where there are no points.
    static std::unique_ptr<Cloud> of(const std::vector<Vec3d>& all) {
        return all.empty() ? nullptr : std::make_unique<Cloud>(all);
    }

    std::vector<double> distances(const std::vector<Vec3d>& from, double limit) const {
        std::vector<double> out(from.size());
        parallel_for(Cpu{}, static_cast<int>(from.size()), [&](int i) {
            const auto at = static_cast<std::size_t>(i);
            std::size_t index = 0;
            double squared = std::numeric_limits<double>::infinity();
            const bool near = tree.nearest_within(from[at], limit * limit, &index, &squared);
            out[at] = near ? std::sqrt(squared) : std::numeric_limits<double>::infinity();
        });
        return out;
    }
};

Surface::Surface() = default;
Surface::Surface(const TriangleMesh& mesh) : triangles_(mesh) {}
Surface::Surface(const std::vector<Vec3f>& points) : cloud_(Cloud::of(finite_points(points))) {}
Surface::Surface(const std::vector<Vec3d>& points) : cloud_(Cloud::of(finite_points(points))) {}
Surface::Surface(Surface&&) noexcept = default;
Surface& Surface::operator=(Surface&&) noexcept = default;
Surface::~Surface() = default;

bool Surface::empty() const {
    return triangles_.empty() && cloud_ == nullptr;
}

const TriangleTree& Surface::triangles() const {
    return triangles_;
}

std::vector<double> Surface::distances(const std::vector<Vec3d>& points, double limit) const {
    const std::vector<std::uint32_t> order = order_in_space(points);
    const std::vector<Vec3d> from = in_order(points, order);
    const std::vector<double> near =
        cloud_ ? cloud_->distances(from, limit) : triangles_.distances(from, limit);
    std::vector<double> out(points.size());
    for (std::size_t i = 0; i < order.size(); ++i) out[order[i]] = near[i];
    return out;
}

SamplePoints all_points(const std::vector<Vec3f>& points) {
    return {finite_points(points), {}, 0};
}

std::vector<double> nearest_distances(const std::vector<Vec3d>& points,
                                      const std::vector<Vec3d>& targets) {
    return Surface(targets).distances(points);
}

}  // namespace tvsgs
