#include "render/depth/ray_depth.h"

#include "render/tiles/blend_cpu.h"

namespace tvsgs {

void find_medians(Cpu, const MedianView& in, Buffer<Crossing, Cpu>&) {
    parallel_for_heavy(Cpu{}, in.grid.count(), [&](int tile) {
        const TileBounds t = tile_bounds(in.grid, tile);
        const std::uint32_t begin = in.spans[static_cast<std::size_t>(tile)].begin;
        for (int y = t.top; y < t.bottom; ++y)
            for (int x = t.left; x < t.right; ++x) {
                const std::size_t pixel = pixel_index(in.grid, x, y);
                const std::uint32_t end = in.transmittance[pixel] <= 0.5f ? in.stops[pixel] : 0;
                std::uint32_t stop = 0;
                MedianRange<float> range;
                Crossing crossings[kDepthSplats];
                for (std::uint32_t at = 0; at < end && !range.complete(); ++at) {
                    const std::uint32_t splat = in.splats[begin + at];
                    const auto& shape = in.shapes[splat];
                    const auto hit = RayDepthModel::hit(
                        shape, RayDepthModel::offset(shape, detail::pixel_centre(x, y)));
                    if (hit.alpha == 0) continue;
                    const RayPoint<float> point = ray_point(in.profiles[splat], hit.offset);
                    if (!range.add(hit.alpha, point)) continue;
                    crossings[range.count - 1] = {hit.alpha, point.depth, point.inverse};
                    stop = at + 1;
                }
                MedianSearch<float> search;
                const auto look = [&](const auto& points, auto& squares) {
                    squared_transmittances(
                        range.count, [&](int i) { return crossings[i]; }, points, squares);
                };
                const bool found = find_median(range, look, search);
                in.depth[pixel] = found ? search.median() : 0;
                in.slope[pixel] = found ? search.slope() : 0;
                in.median_stops[pixel] = found ? stop : 0;
            }
    });
}

TVSGS_BLEND_CPU(MeanDepthModel)
TVSGS_BLEND_BACK_CPU(MedianDepthModel)

}  // namespace tvsgs
