#include <cmath>
#include <cstddef>

#include "core/device/parallel.h"
#include "mesh/closed/poisson_solve.h"

namespace tvsgs {
namespace {

// Sum of the hats at a point of a plane of density 1; 2/3 for an axis-aligned plane.
constexpr float kPlaneShare = 0.68f;
constexpr float kMinDensity = 1;    // sum of the hats at a point that has neighbours
constexpr int kMaxLevelsAbove = 3;  // below the median level

}  // namespace

PointBins::PointBins(const OrientedPoints& points, const PoissonLevel& level)
    : first(level.keys.size() + 1) {
    std::vector<int> block(points.size());
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) {
        const auto at = static_cast<std::size_t>(i);
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
    parallel_for(Cpu{}, static_cast<int>(order.size()), [&](int i) {
        const auto at = static_cast<std::size_t>(i);
        hats[at] = Hat(points.positions[order[at]], level.spacing);
    });
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
        parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) {
            const auto at = static_cast<std::size_t>(i);
            if (found.levels[at] >= 0) return;
            LevelReader reader(one, 0);
            const Hat hat(points.positions[at], spacing);
            float sum = 0;
            for (int c = 0; c < 8; ++c)
                sum += hat.share(corner_of(c)) * reader.at(hat.base + corner_of(c), 0);
            density[at] = sum;
        });
        for (std::size_t i = 0; i < points.size(); ++i) {
            if (found.levels[i] >= 0 || (!(density[i] >= kMinDensity) && l > 0)) continue;
            found.levels[i] = l, --left;
            found.areas[i] = spacing * spacing * kPlaneShare / density[i];
        }
    }
    std::vector<int> sorted = found.levels;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    for (int& level : found.levels)
        if (level < *middle - kMaxLevelsAbove) level = -1, ++found.isolated;
    return found;
}

}  // namespace tvsgs
