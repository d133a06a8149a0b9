#include "mesh/closed/poisson.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/error.h"
#include "mesh/closed/poisson_solve.h"

namespace tvsgs {
namespace {

constexpr double kMargin = 0.1;  // margin around the points' box, as a share of its longest side
constexpr int kReach = 3;        // nodes of a level on each side of a point
// A level with at most so many nodes along the longest side is dense.
constexpr int kDenseNodes = 64;
constexpr int kCoarsestNodes = 16;  // most nodes of the coarsest level along the longest side

/// Bounding box of the points, with a margin.
PoissonBox box_around(const OrientedPoints& points) {
    constexpr double kFar = std::numeric_limits<double>::infinity();
    PoissonBox box{{kFar, kFar, kFar}, {-kFar, -kFar, -kFar}};
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (!is_finite(points.positions[i]) || !is_finite(points.normals[i]))
            throw Error(ExitCode::input, "point ", i, " of ", points.size(), " is not finite");
        for (int axis = 0; axis < 3; ++axis) {
            const auto x = static_cast<double>(points.positions[i][axis]);
            box.low[axis] = std::min(box.low[axis], x);
            box.high[axis] = std::max(box.high[axis], x);
        }
    }
    const double margin = kMargin * box.side();
    if (!(margin > 0))
        throw Error(ExitCode::input, "all ", points.size(), " points are in one place: no surface");
    box.low -= {margin, margin, margin}, box.high += {margin, margin, margin};
    return box;
}

/// Spacings of the levels, the coarsest first.
std::vector<float> spacings_of(const PoissonBox& box, float finest) {
    double farthest = 0;
    for (int axis = 0; axis < 3; ++axis)
        farthest = std::max({farthest, std::abs(box.low[axis]), std::abs(box.high[axis])});
    constexpr double kMaxNodes = (kBlockReach - 8.0) * kBlockEdge;  // on each side of the origin
    if (!(finest > 0 && farthest < kMaxNodes * static_cast<double>(finest)))
        throw Error(ExitCode::input, "points up to ", farthest,
                    " from the origin are too far out for nodes ", finest,
                    " apart; raise --voxel-size or lower --depth-max");
    std::vector<float> spacings{finest};
    while (box.side() > kCoarsestNodes * static_cast<double>(spacings.front()))
        spacings.insert(spacings.begin(), 2 * spacings.front());
    return spacings;
}

using Keys = std::vector<std::uint64_t>;

/// The blocks of each level: all blocks of the box on coarse levels, blocks near points on fine
/// ones.
std::vector<Keys> choose_blocks(const OrientedPoints& points,
                                const Densities& densities,
                                const PoissonBox& box,
                                const std::vector<float>& spacings) {
    std::vector<Keys> keys(spacings.size());
    for (std::size_t l = spacings.size(); l-- > 0;) {
        const float spacing = spacings[l];
        if (l == 0 || box.side() <= kDenseNodes * static_cast<double>(spacing))
            add_blocks(node_below(vec_cast<float>(box.low), spacing),
                       node_below(vec_cast<float>(box.high), spacing) + Vec3i{1, 1, 1}, keys[l]);
        else
            keys[l] = blocks_near(points, spacing, kReach, [&](std::size_t i) {
                return densities.levels[i] >= static_cast<int>(l);
            });
        if (l + 1 < keys.size()) add_parents(keys[l + 1], keys[l]);
        sort_unique(keys[l]);
    }
    return keys;
}

std::int64_t bytes_of(const std::vector<Keys>& keys, std::size_t points) {
    constexpr std::int64_t kPoint = 100, kBlock = 1500;  // bytes each, with bookkeeping
    std::int64_t bytes = kPoint * static_cast<std::int64_t>(points);
    for (std::size_t l = 0; l < keys.size(); ++l) {
        const bool last = l + 1 == keys.size();  // the largest level that has equations
        bytes +=
            static_cast<std::int64_t>(keys[l].size()) * (kBlock + kBlockVoxels * (last ? 13 : 5));
    }
    return bytes;
}

}  // namespace

PoissonField solve_poisson(const OrientedPoints& points,
                           const EvidenceSource& evidence,
                           const PoissonOptions& options) {
    const PoissonBox box = box_around(points);
    std::vector<float> spacings = spacings_of(box, options.spacing);
    const Densities densities = measure_densities(points, spacings);
    PoissonField field;
    field.isolated = densities.isolated;
    std::vector<Keys> keys;
    for (;; spacings.pop_back()) {
        if (spacings.empty())
            throw Error(ExitCode::memory, "a closed surface of ", points.size(),
                        " points needs at least ", field.bytes, " bytes; ", options.max_bytes,
                        " are available; raise --memory");
        keys = choose_blocks(points, densities, box, spacings);
        field.bytes = bytes_of(keys, points.size());
        const bool fits = options.max_bytes <= 0 || field.bytes <= options.max_bytes;
        // Empty if the points are too sparse for this level.
        if (fits && !keys.back().empty()) break;
    }
    for (std::size_t l = 0; l < keys.size(); ++l)
        field.levels.emplace_back(spacings[l], std::move(keys[l]));
    const FreeNodes free = find_free_nodes(field.levels, evidence);
    for (int l = 0; l < static_cast<int>(field.levels.size()); ++l)
        solve_level(field.levels, l,
                    make_equations(points, densities, field.levels[l], free[l], box));
    return field;
}

}  // namespace tvsgs
