#include "render/ray_depth.h"

#include <vector>

#include "render/blend_cpu.h"

namespace tvsgs {
namespace {

/// A splat that a pixel blends.
struct Crossing {
    float alpha;
    RayPoint<float> point;
    std::uint32_t position;  // in the tile's list
};

float passed(const std::vector<Crossing>& splats, float depth) {
    float square = 1;
    for (const Crossing& c : splats)
        square *= passed_square(c.alpha, (depth - c.point.depth) * c.point.inverse);
    return square;
}

/// Of d ln T / d depth.
float slope_at(const std::vector<Crossing>& splats, float depth) {
    float slope = 0;
    for (const Crossing& c : splats)
        slope += passed_vjp(c.alpha, (depth - c.point.depth) * c.point.inverse, c.point.deviation,
                            c.point.inverse)
                     .by_depth;
    return slope;
}

struct Median {
    float depth = 0, slope = 0;
    std::uint32_t stop = 0;
};
Median median_of(const std::vector<Crossing>& splats) {
    MedianRange<float> range;
    for (const Crossing& c : splats) range.add(c.alpha, c.point);
    MedianSearch<float> search;
    if (!find_median(
            range, [&](float t) { return passed(splats, t); }, search))
        return {};
    Median median;
    median.depth = search.median();
    median.slope = slope_at(splats, median.depth);
    for (const Crossing& c : splats)
        if (c.point.depth - kProfileReach * c.point.deviation < search.high)
            median.stop = c.position + 1;
    return median;
}

}  // namespace

void find_medians(Cpu, const MedianView& in) {
    parallel_for_heavy(Cpu{}, in.grid.count(), [&](int tile) {
        const TileBounds t = tile_bounds(in.grid, tile);
        const std::uint32_t begin = in.spans[static_cast<std::size_t>(tile)].begin;
        std::vector<Crossing> splats;
        for (int y = t.top; y < t.bottom; ++y)
            for (int x = t.left; x < t.right; ++x) {
                const std::size_t pixel = pixel_index(in.grid, x, y);
                splats.clear();
                const bool covered = in.transmittance[pixel] <= 0.5f;
                for (std::uint32_t at = 0; covered && at < in.stops[pixel]; ++at) {
                    const std::uint32_t splat = in.splats[begin + at];
                    const auto& shape = in.shapes[splat];
                    const auto hit = RayDepthModel::hit(
                        shape, RayDepthModel::offset(shape, detail::pixel_centre(x, y)));
                    if (hit.alpha > 0)
                        splats.push_back(
                            {hit.alpha, ray_point(in.profiles[splat], hit.offset), at});
                }
                const Median median = covered ? median_of(splats) : Median{};
                in.depth[pixel] = median.depth, in.slope[pixel] = median.slope;
                in.median_stops[pixel] = median.stop;
            }
    });
}

TVSGS_BLEND_CPU(MeanDepthModel)
TVSGS_BLEND_BACK_CPU(MedianDepthModel)

}  // namespace tvsgs
