// Sets up and solves the linear equations of one level of nodes.
#pragma once

#include <vector>

#include "mesh/closed/poisson_points.h"

namespace tvsgs {

/// The field's target outside of the surface; the target inside is the negative.
inline constexpr float kOutsideValue = -0.5f;

/// Nodes outside of the box are outside of the solid.
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

/// For each level, whether views look through a node, [B 512].
using FreeNodes = std::vector<std::vector<std::uint8_t>>;
FreeNodes find_free_nodes(const std::vector<PoissonLevel>& levels, const EvidenceSource& evidence);

/// At each node: diag value - (sum of the six neighbours' values) = rhs.
struct PoissonEquations {
    std::vector<float> diag, rhs;  // [B 512]
};
PoissonEquations make_equations(const OrientedPoints& points,
                                const Densities& densities,
                                const PoissonLevel& level,
                                const std::vector<std::uint8_t>& free,
                                const PoissonBox& box);

/// Solves for the values of level l. Boundary values come from coarser levels, which must be
/// solved.
void solve_level(std::vector<PoissonLevel>& levels, int l, const PoissonEquations& equations);

}  // namespace tvsgs
