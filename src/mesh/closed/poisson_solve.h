// The equations of a level of nodes, and their solution.
#pragma once

#include <vector>

#include "mesh/closed/poisson_points.h"

namespace tvsgs {

/// What lies outside of the surface tends to that, what lies inside to its negative.
inline constexpr float kOutsideValue = -0.5f;

/// Beyond it nothing is inside.
struct PoissonBox {
    Vec3d low, high;

    double side() const {
        const Vec3d size = high - low;
        return std::max({size.x, size.y, size.z});
    }
    bool has(Vec3d p) const {
        for (int axis = 0; axis < 3; ++axis)
            if (!(p[axis] >= low[axis] && p[axis] <= high[axis])) return false;
        return true;
    }
};

/// Of the nodes of each level, whether views look through them, [B 512].
using FreeNodes = std::vector<std::vector<std::uint8_t>>;
FreeNodes find_free_nodes(const std::vector<PoissonLevel>& levels, const EvidenceSource& evidence);

/// diag value - (the six values around) = rhs, at each node of a level.
struct PoissonEquations {
    std::vector<float> diag, rhs;  // [B 512]
};
PoissonEquations make_equations(const OrientedPoints& points,
                                const Densities& densities,
                                const PoissonLevel& level,
                                const std::vector<std::uint8_t>& free,
                                const PoissonBox& box);

/// Sets the values of level l. What the level lacks beside its nodes comes from coarser ones, which
/// must have their values.
void solve_level(std::vector<PoissonLevel>& levels, int l, const PoissonEquations& equations);

}  // namespace tvsgs
