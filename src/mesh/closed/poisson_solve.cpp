#include "mesh/closed/poisson_solve.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/device/parallel.h"
#include "core/math/quantile.h"
#include "mesh/fuse/pixel_trust.h"

namespace tvsgs {
namespace {

// Sum of the hats at a point of a plane of density 1; 2/3 for an axis-aligned plane.
constexpr float kPlaneShare = 0.68f;
constexpr float kMinDensity = 1;    // sum of the hats at a point that has neighbours
constexpr int kMaxLevelsAbove = 3;  // below the median level

constexpr float kScreening = 16;  // weight of points, relative to smoothness
// Weight of a node that views look through, relative to smoothness.
constexpr float kFreeWeight = 4;
constexpr float kFixedWeight = 1e4f;  // weight of a node outside of the box
constexpr float kFreeLimitPx = 3;     // distance in front of a depth, as for evidence
constexpr float kTolerance = 2e-4f;   // a sweep has converged if no value changes by more
constexpr int kMaxSweeps = 200;

std::size_t first_node(int block) {
    return static_cast<std::size_t>(block) * kBlockVoxels;
}
Vec3i origin_of(const PoissonLevel& level, int block) {
    return kBlockEdge * block_of_key(level.keys[block]);
}
Vec3i along(int axis, int step) {
    Vec3i p{};
    p[axis] = step;
    return p;
}

/// Numbers of views, up to 255. Exists only before the levels have values, which need more memory.
struct ViewCounts {
    std::uint8_t see, through;
};

/// Judges a node in one view, like a sample of mesh_evidence.h, with a distance limit that is
/// larger by one spacing.
void count_view(const EvidenceView& view, Vec3f node, float spacing, ViewCounts& counts) {
    const Camera& camera = view.camera;
    if (!is_in_view(camera, node)) return;
    const Vec3f p = camera.camera_from_world * node;
    const int x = static_cast<int>(camera.fx_px * p.x / p.z + camera.cx_px),
              y = static_cast<int>(camera.fy_px * p.y / p.z + camera.cy_px);
    const int pixel = y * camera.width_px + x;
    const float depth = view.depth[pixel];
    const float limit = kFreeLimitPx * p.z / camera.fx_px + spacing;
    if (!(depth > 0) || !(p.z <= depth + limit)) return;
    if (!(p.z < depth - limit))
        counts.see = static_cast<std::uint8_t>(std::min(counts.see + 1, 255));
    else if (view.weight[pixel] >= kTrustedWeight)
        counts.through = static_cast<std::uint8_t>(std::min(counts.through + 1, 255));
}

/// Calls action(node beside the block, the same node in the neighbouring block's coordinates) for
/// one side of a block.
template <class Action>
void for_side(int axis, int side, const Action& action) {
    for (int i = 0; i < kBlockEdge * kBlockEdge; ++i) {
        Vec3i node;
        node[(axis + 1) % 3] = i % kBlockEdge, node[(axis + 2) % 3] = i / kBlockEdge;
        node[axis] = side < 0 ? -1 : kBlockEdge;
        Vec3i theirs = node;
        theirs[axis] = side < 0 ? kBlockEdge - 1 : 0;
        action(node, theirs);
    }
}

/// Boundary value beside a block whose neighbour does not exist on this level.
struct BoundaryValue {
    std::uint16_t place;  // index in the halo
    float value;
};

/// Interpolates the values from coarser levels; returns the boundary values of each block.
std::vector<std::vector<BoundaryValue>> interpolate_coarser(std::vector<PoissonLevel>& levels,
                                                            int l) {
    PoissonLevel& level = levels[l];
    level.values.resize(level.keys.size() * kBlockVoxels);
    std::vector<std::vector<BoundaryValue>> boundaries(level.keys.size());
    parallel_for_heavy(Cpu{}, level.size(), [&](int b) {
        LevelReader reader(levels, l - 1);
        const auto above = [&](Vec3i node) {
            return reader.between(origin_of(level, b) + node, kOutsideValue);
        };
        for (int i = 0; i < kBlockVoxels; ++i)
            level.values[first_node(b) + i] = above(local_of_index(i));
        for (int axis = 0; axis < 3; ++axis)
            for (const int side : {-1, 1})
                if (level.neighbour(b, along(axis, side)) < 0)
                    for_side(axis, side, [&](Vec3i node, Vec3i) {
                        boundaries[b].push_back(
                            {static_cast<std::uint16_t>(halo_index(node)), above(node)});
                    });
    });
    return boundaries;
}

/// Two Gauss-Seidel sweeps over a block, forward and backward; returns the largest change.
float relax_block(PoissonLevel& level,
                  int b,
                  const std::vector<BoundaryValue>& boundary,
                  const PoissonEquations& equations) {
    std::array<float, kHaloNodes> x;
    float* const values = &level.values[first_node(b)];
    const float *const rhs = &equations.rhs[first_node(b)], *const diag =
                                                                &equations.diag[first_node(b)];
    for (int i = 0; i < kBlockVoxels; ++i) x[halo_index(local_of_index(i))] = values[i];
    for (const BoundaryValue& beside : boundary) x[beside.place] = beside.value;
    for (int axis = 0; axis < 3; ++axis)
        for (const int side : {-1, 1})
            if (const int beside = level.neighbour(b, along(axis, side)); beside >= 0)
                for_side(axis, side, [&](Vec3i node, Vec3i theirs) {
                    x[halo_index(node)] = level.values[first_node(beside) + local_index(theirs)];
                });
    float change = 0;
    const auto relax = [&](int i) {
        constexpr std::size_t kY = kHaloEdge, kZ = kHaloEdge * kHaloEdge;
        const std::size_t at = halo_index(local_of_index(i));
        const float sum = x[at - 1] + x[at + 1] + x[at - kY] + x[at + kY] + x[at - kZ] + x[at + kZ];
        const float next = (rhs[i] + sum) / diag[i];
        change = std::max(change, std::fabs(next - x[at]));
        x[at] = next;
    };
    for (int i = 0; i < kBlockVoxels; ++i) relax(i);
    for (int i = kBlockVoxels - 1; i >= 0; --i) relax(i);
    for (int i = 0; i < kBlockVoxels; ++i) values[i] = x[halo_index(local_of_index(i))];
    return change;
}

}  // namespace

PointBins::PointBins(const OrientedPoints& points, const PoissonLevel& level)
    : first(level.keys.size() + 1) {
    std::vector<int> block(points.size());
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int at) {
        block[at] = level.find(block_of_node(node_below(points.positions[at], level.spacing)));
    });
    for (const int b : block)
        if (b >= 0) ++first[static_cast<std::size_t>(b) + 1];
    for (std::size_t b = 1; b < first.size(); ++b) first[b] += first[b - 1];
    order.resize(static_cast<std::size_t>(first.back()));
    std::vector<int> next(first.begin(), first.end() - 1);
    for (std::size_t i = 0; i < block.size(); ++i)
        if (block[i] >= 0) order[next[block[i]]++] = static_cast<int>(i);
    hats.resize(order.size());
    parallel_for(Cpu{}, static_cast<int>(order.size()),
                 [&](int at) { hats[at] = Hat(points.positions[order[at]], level.spacing); });
}

Densities measure_densities(const OrientedPoints& points, const std::vector<float>& spacings) {
    Densities found{std::vector<float>(points.size()), std::vector<int>(points.size(), -1)};
    std::size_t left = points.size();
    for (int l = static_cast<int>(spacings.size()) - 1; l >= 0 && left > 0; --l) {
        const float spacing = spacings[l];
        PoissonLevel level(spacing,
                           blocks_near(points, spacing, 0, [](std::size_t) { return true; }));
        level.values.resize(level.keys.size() * kBlockVoxels);
        const PointBins bins(points, level);
        parallel_for_heavy(Cpu{}, level.size(), [&](int b) {
            float* const values = &level.values[static_cast<std::size_t>(b) * kBlockVoxels];
            for_points_around(level, bins, b, [&](int, Vec3i node, float share) {
                if (in_block(node)) values[local_index(node)] += share;
            });
        });
        const std::vector<PoissonLevel> one{std::move(level)};
        std::vector<float> density(points.size());
        parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int at) {
            if (found.levels[at] >= 0) return;
            LevelReader reader(one, 0);
            const Hat hat(points.positions[at], spacing);
            float sum = 0;
            for (int c = 0; c < 8; ++c)
                sum += hat.share(corner_offset(c)) * reader.at(hat.base + corner_offset(c), 0);
            density[at] = sum;
        });
        for (std::size_t i = 0; i < points.size(); ++i) {
            if (found.levels[i] >= 0 || (!(density[i] >= kMinDensity) && l > 0)) continue;
            found.levels[i] = l, --left;
            found.areas[i] = spacing * spacing * kPlaneShare / density[i];
        }
    }
    std::vector<int> sorted = found.levels;
    const int middle = middle_of(sorted);
    for (int& level : found.levels)
        if (level < middle - kMaxLevelsAbove) level = -1, ++found.isolated;
    return found;
}

FreeNodes find_free_nodes(const std::vector<PoissonLevel>& levels, const EvidenceSource& evidence) {
    std::vector<std::vector<ViewCounts>> counts;
    for (const PoissonLevel& level : levels) counts.emplace_back(level.keys.size() * kBlockVoxels);
    for (int v = 0; v < evidence.count; ++v) {
        const EvidenceView view = evidence.view(v);
        for (std::size_t l = 0; l < levels.size(); ++l)
            parallel_for_heavy(Cpu{}, levels[l].size(), [&](int b) {
                const Vec3i origin = origin_of(levels[l], b);
                for (int i = 0; i < kBlockVoxels; ++i)
                    count_view(view,
                               vec_cast<float>(levels[l].position(origin + local_of_index(i))),
                               levels[l].spacing, counts[l][first_node(b) + i]);
            });
    }
    FreeNodes free(levels.size());
    for (std::size_t l = 0; l < levels.size(); ++l) {
        free[l].reserve(counts[l].size());
        for (const ViewCounts look : counts[l])
            free[l].push_back(look.through > 0 && 2 * look.through >= look.see);
        counts[l] = {};
    }
    return free;
}

PoissonEquations make_equations(const OrientedPoints& points,
                                const Densities& densities,
                                const PoissonLevel& level,
                                const std::vector<std::uint8_t>& free,
                                const PoissonBox& box) {
    const std::size_t nodes = level.keys.size() * kBlockVoxels;
    PoissonEquations made{std::vector<float>(nodes), std::vector<float>(nodes)};
    const PointBins bins(points, level);
    const float h = level.spacing;
    parallel_for_heavy(Cpu{}, level.size(), [&](int b) {
        std::array<Vec3f, kHaloNodes> flux{};  // of the normals, times the spacing
        float *const diag = &made.diag[first_node(b)], *const rhs = &made.rhs[first_node(b)];
        const Vec3i origin = origin_of(level, b);
        for_points_around(level, bins, b, [&](int i, Vec3i node, float share) {
            if (densities.levels[i] < 0) return;
            const Vec3f normal = points.normals[i];
            const float weight = share * densities.areas[i] / (h * h);
            flux[halo_index(node)] += weight * normal;
            if (!in_block(node)) return;
            const float in_front =
                dot(normal, vec_cast<float>(level.position(origin + node)) - points.positions[i]);
            diag[local_index(node)] += kScreening * weight;
            rhs[local_index(node)] +=
                kScreening * weight *
                std::clamp(-in_front / (2 * h), kOutsideValue, -kOutsideValue);
        });
        for (int i = 0; i < kBlockVoxels; ++i) {
            const Vec3i node = local_of_index(i);
            float known = 0;
            if (!box.has(level.position(origin + node)))
                known = kFixedWeight;
            else if (diag[i] == 0 && free[first_node(b) + i])  // no point is near
                known = kFreeWeight;
            for (int axis = 0; axis < 3; ++axis)
                rhs[i] += 0.5f * (flux[halo_index(node + along(axis, 1))][axis] -
                                  flux[halo_index(node - along(axis, 1))][axis]);
            diag[i] += 6 + known, rhs[i] += known * kOutsideValue;
        }
    });
    return made;
}

void solve_level(std::vector<PoissonLevel>& levels, int l, const PoissonEquations& equations) {
    const std::vector<std::vector<BoundaryValue>> boundaries = interpolate_coarser(levels, l);
    PoissonLevel& level = levels[l];
    std::vector<int> colors[2];  // blocks of one colour do not touch
    for (int b = 0; b < level.size(); ++b) {
        const Vec3i block = block_of_key(level.keys[b]);
        colors[(block.x + block.y + block.z) & 1].push_back(b);
    }
    // A block is skipped while neither it nor its neighbours change.
    std::vector<float> changes(level.keys.size(), 1);
    const auto moves = [&](int b) {
        bool any = changes[b] >= kTolerance;
        for (int axis = 0; axis < 3; ++axis)
            for (const int side : {-1, 1})
                if (const int beside = level.neighbour(b, along(axis, side)); beside >= 0)
                    any |= changes[beside] >= kTolerance;
        return any;
    };
    for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
        for (const std::vector<int>& color : colors)
            parallel_for_heavy(Cpu{}, static_cast<int>(color.size()), [&](int k) {
                const int b = color[k];
                changes[b] = moves(b) ? relax_block(level, b, boundaries[b], equations) : 0;
            });
        if (*std::ranges::max_element(changes) < kTolerance) break;
    }
}

}  // namespace tvsgs
