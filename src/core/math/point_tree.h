// Nearest neighbours in a point cloud on the host, by nanoflann.
#pragma once

#include <nanoflann.hpp>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// Squared distances have the type `Real`, stored coordinates the type `Coordinate`. The points
/// must outlive the tree.
template <class Real, class Coordinate = float>
class PointTree {
public:
    explicit PointTree(const std::vector<Vec3<Coordinate>>& points)
        : points_{points}, tree_(3, points_, nanoflann::KDTreeSingleIndexAdaptorParams(16)) {}
    PointTree(const PointTree&) = delete;
    PointTree& operator=(const PointTree&) = delete;

    /// Finds up to `wanted` nearest points, nearest first; returns how many it found.
    std::size_t nearest(Vec3<Coordinate> to,
                        std::size_t wanted,
                        std::size_t* index,
                        Real* squared) const {
        const Real query[3] = {to.x, to.y, to.z};
        return tree_.knnSearch(query, wanted, index, squared);
    }

    /// Finds the nearest point closer than the root of `limit`; returns false if there is none.
    bool nearest_within(Vec3<Coordinate> to, Real limit, std::size_t* index, Real* squared) const {
        const Real query[3] = {to.x, to.y, to.z};
        Closest closest{limit};
        tree_.findNeighbors(closest, query, nanoflann::SearchParams());
        *index = closest.index, *squared = closest.squared;
        return closest.found;
    }

private:
    /// The result set that nanoflann expects, for the closest point only.
    struct Closest {
        Real squared;
        std::size_t index = 0;
        bool found = false;

        bool addPoint(Real distance, std::size_t i) {
            if (distance < squared) squared = distance, index = i, found = true;
            return true;
        }
        Real worstDist() const { return squared; }
        bool full() const { return found; }
    };

    /// The point set that nanoflann expects.
    struct Points {
        const std::vector<Vec3<Coordinate>>& points;

        std::size_t kdtree_get_point_count() const { return points.size(); }
        Real kdtree_get_pt(std::size_t i, std::size_t axis) const {
            return points[i][static_cast<int>(axis)];
        }
        template <class Box>
        bool kdtree_get_bbox(Box&) const {
            return false;
        }
    };

    Points points_;
    nanoflann::
        KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<Real, Points>, Points, 3, std::size_t>
            tree_;
};

}  // namespace tvsgs
