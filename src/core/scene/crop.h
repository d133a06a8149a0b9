// Region of space in which an evaluation compares surfaces.
#pragma once

#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// The region; `kind` selects the members in use.
struct Crop {
    enum class Kind { everything, box, cylinder, prism };
    Kind kind = Kind::everything;
    // box and cylinder: lower and upper corner (cylinder: only z).
    Vec3d min, max;
    // cylinder around a vertical axis
    double center_x = 0, center_y = 0, radius = 0;
    // prism over a polygon, like the selection volumes of Tanks and Temples
    int axis = 2;  // orthogonal to the polygon
    double axis_min = 0, axis_max = 0;
    std::vector<Vec3d> polygon;  // entry `axis` is not used
};

/// Points on the bounds are inside. Of the polygon's edges only those at the smaller coordinate are
/// inside, as in Open3D.
inline bool contains(const Crop& crop, Vec3d p) {
    switch (crop.kind) {
        case Crop::Kind::everything:
            return true;
        case Crop::Kind::box:
            for (int axis = 0; axis < 3; ++axis)
                if (!(p[axis] >= crop.min[axis] && p[axis] <= crop.max[axis])) return false;
            return true;
        case Crop::Kind::cylinder: {
            const double dx = p.x - crop.center_x, dy = p.y - crop.center_y;
            return p.z >= crop.min.z && p.z <= crop.max.z &&
                   dx * dx + dy * dy <= crop.radius * crop.radius;
        }
        case Crop::Kind::prism: {
            if (!(p[crop.axis] >= crop.axis_min && p[crop.axis] <= crop.axis_max)) return false;
            const int u = crop.axis == 0 ? 1 : 0, v = crop.axis == 2 ? 1 : 2;
            bool inside = false;  // number of crossed edges on the side of smaller u is odd
            for (std::size_t i = 0; i < crop.polygon.size(); ++i) {
                const Vec3d a = crop.polygon[i], b = crop.polygon[(i + 1) % crop.polygon.size()];
                if ((a[v] < p[v] && b[v] >= p[v]) || (b[v] < p[v] && a[v] >= p[v]))
                    inside ^= a[u] + (p[v] - a[v]) / (b[v] - a[v]) * (b[u] - a[u]) < p[u];
            }
            return inside;
        }
    }
    return false;
}

}  // namespace tvsgs
