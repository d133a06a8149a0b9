// Nearest neighbours within a large cloud: one tree per part, built by several threads.
#pragma once

#include <algorithm>
#include <limits>
#include <memory>
#include <vector>

#include "core/device/morton.h"
#include "core/device/parallel_lists.h"
#include "core/math/point_tree.h"

namespace tvsgs {

/// Divides the cloud into parts of points that lie close together, with a tree for each part.
class PointForest {
public:
    static constexpr std::size_t kMostWanted = 32;

    /// Leaves out points that are not finite.
    explicit PointForest(const std::vector<Vec3f>& points)
        : order_(indices_where(points.size(), [&](std::size_t i) { return is_finite(points[i]); })),
          parts_(kListParts) {
        const std::vector<Vec3f> finite = taken(points, order_);
        Buffer<int, Cpu> order;
        morton_order({finite.data(), finite.size()}, order);
        order_ = taken(order_, to_host(order));
        for_parts(order_.size(), [&](std::size_t number, std::size_t first, std::size_t last) {
            Part& part = parts_[number];
            part.points.reserve(last - first);
            for (std::size_t i = first; i < last; ++i) part.points.push_back(points[order_[i]]);
            if (part.points.empty()) return;
            part.low = part.high = part.points.front();
            for (const Vec3f p : part.points)
                for (int axis = 0; axis < 3; ++axis) {
                    part.low[axis] = std::min(part.low[axis], p[axis]);
                    part.high[axis] = std::max(part.high[axis], p[axis]);
                }
            part.tree = std::make_unique<PointTree<float>>(part.points);
        });
    }

    /// Calls action(i, squared distances to the nearest points, ascending, their number) for each
    /// finite point i. There are up to `wanted` distances, including the 0 to the point itself.
    /// Several threads call it at once.
    template <class Action>
    void for_each(std::size_t wanted, const Action& action) const {
        for_parts(order_.size(), [&](std::size_t number, std::size_t first, std::size_t last) {
            const Part& own = parts_[number];
            for (std::size_t i = first; i < last; ++i) {
                Nearest nearest{wanted};
                const Vec3f p = own.points[i - first];
                own.search(p, nearest);
                for (const Part& part : parts_)
                    if (&part != &own && part.tree && part.squared_distance(p) <= nearest.limit())
                        part.search(p, nearest);
                action(order_[i], nearest.squared, nearest.count);
            }
        });
    }

private:
    struct Nearest {
        std::size_t wanted, count = 0;
        float squared[kMostWanted] = {};

        float limit() const {
            return count < wanted ? std::numeric_limits<float>::infinity() : squared[count - 1];
        }
    };
    struct Part {
        std::vector<Vec3f> points;
        std::unique_ptr<PointTree<float>> tree;
        Vec3f low, high;

        /// Squared distance to the box, rounded as the tree rounds distances. It is a lower bound
        /// of the distances to the part's points.
        float squared_distance(Vec3f p) const {
            float sum = 0;
            for (int axis = 0; axis < 3; ++axis) {
                const float d = std::max({low[axis] - p[axis], p[axis] - high[axis], 0.0f});
                sum += d * d;
            }
            return sum;
        }
        void search(Vec3f p, Nearest& nearest) const {
            std::size_t index[kMostWanted];
            float here[kMostWanted], both[2 * kMostWanted];
            const std::size_t found = tree->nearest(p, nearest.wanted, index, here);
            std::merge(nearest.squared, nearest.squared + nearest.count, here, here + found, both);
            nearest.count = std::min(nearest.wanted, nearest.count + found);
            std::copy(both, both + nearest.count, nearest.squared);
        }
    };

    std::vector<int> order_;
    std::vector<Part> parts_;
};

}  // namespace tvsgs
