// Nearest points of a cloud on the host, by nanoflann.
#pragma once

#include <nanoflann.hpp>
#include <vector>

#include "core/vec.h"

namespace tvsgs {

struct PointAdaptor {
    const std::vector<Vec3f>& points;
    std::size_t kdtree_get_point_count() const { return points.size(); }
    float kdtree_get_pt(std::size_t i, std::size_t axis) const {
        return points[i][static_cast<int>(axis)];
    }
    template <class Box>
    bool kdtree_get_bbox(Box&) const {
        return false;
    }
};
using PointTree =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, PointAdaptor>,
                                        PointAdaptor,
                                        3,
                                        unsigned>;

}  // namespace tvsgs
