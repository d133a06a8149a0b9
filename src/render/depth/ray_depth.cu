#include "render/depth/ray_depth.h"
#include "render/tiles/blend_cuda.h"

namespace tvsgs {
namespace {

using namespace blend_detail;

constexpr int kBlocks = 768;  // each has its own scratch and processes several tiles
constexpr int kTilePixels = kThreads * kPixels;

/// Scratch of a lane's pixel. Crossings of neighbouring pixels are adjacent.
struct LaneCrossings {
    Crossing* first;
    __device__ LaneCrossings(Span<Crossing> all, int k)
        : first(all.data + blockIdx.x * (kDepthSplats * kTilePixels) + k * kThreads + threadIdx.x) {
    }
    __device__ Crossing& operator[](int i) const { return first[i * kTilePixels]; }
};

/// Walks the list once and stores the splats that count for each pixel; then each pixel searches
/// its median.
__device__ void find_tile_medians(const MedianView& in,
                                  unsigned tile,
                                  const LaneCrossings (&crossings)[kPixels],
                                  Batch<RayDepthModel>& batch) {
    const LanePixels p = lane_pixels(in.grid, tile);
    const std::uint32_t begin = in.spans[tile].begin, lane = threadIdx.x % 32;
    std::uint32_t stop[kPixels] = {}, last[kPixels] = {};
    MedianRange<float> ranges[kPixels];
#pragma unroll
    for (int k = 0; k < kPixels; ++k) {
        const int at = p.y[k] * in.grid.width + p.x;
        if (p.inside[k] && in.transmittance[at] <= 0.5f) stop[k] = in.stops[at];
    }
    const std::uint32_t end = warp_maximum(max(stop[0], stop[1]));
    for (std::uint32_t first = 0; first < end; first += kBatch) {
        if (__all_sync(kAll, (stop[0] <= first || ranges[0].complete()) &&
                                 (stop[1] <= first || ranges[1].complete())))
            break;
        const bool has_splat = first + lane < end;
        unsigned mask =
            load_batch<RayDepthModel>(has_splat, has_splat ? in.splats[begin + first + lane] : 0,
                                      in.shapes, in.profiles, p, batch);
        for (; mask != 0; mask &= mask - 1) {
            const int j = __ffs(static_cast<int>(mask)) - 1;
            const std::uint32_t position = first + static_cast<std::uint32_t>(j);
            const SplatShape<float> shape = batch.shapes[j];
#pragma unroll
            for (int k = 0; k < kPixels; ++k) {
                if (position >= stop[k]) continue;
                const auto hit = RayDepthModel::hit(shape, offset<RayDepthModel>(shape, p, k));
                if (hit.alpha == 0) continue;
                const RayPoint<float> point = ray_point(batch.features[j], hit.offset);
                if (!ranges[k].add(hit.alpha, point)) continue;
                crossings[k][ranges[k].count - 1] = {hit.alpha, point.depth, point.inverse};
                last[k] = position + 1;
            }
        }
        __syncwarp();  // before the next batch overwrites this one
    }
#pragma unroll
    for (int k = 0; k < kPixels; ++k) {
        if (!p.inside[k]) continue;
        MedianSearch<float> search;
        const auto look = [&](const auto& points, auto& squares) {
            squared_transmittances(
                ranges[k].count, [&](int i) { return crossings[k][i]; }, points, squares);
        };
        const bool found = find_median(ranges[k], look, search);
        const int at = p.y[k] * in.grid.width + p.x;
        in.depth[at] = found ? search.median() : 0;
        in.slope[at] = found ? search.slope() : 0;
        in.median_stops[at] = found ? last[k] : 0;
    }
    __syncwarp();  // before the batches of the next tile
}

__global__ void __launch_bounds__(kThreads) median_kernel(MedianView in, Span<Crossing> all) {
    // Bytes, because a splat's shape has a constructor and shared memory must not.
    __shared__ alignas(16) unsigned char batches[kWarps][sizeof(Batch<RayDepthModel>)];
    auto& batch = *reinterpret_cast<Batch<RayDepthModel>*>(batches[threadIdx.x / 32]);
    const LaneCrossings crossings[kPixels] = {{all, 0}, {all, 1}};
    for (unsigned tile = blockIdx.x; tile < static_cast<unsigned>(in.grid.count());
         tile += gridDim.x)
        find_tile_medians(in, tile, crossings, batch);
}

}  // namespace

void find_medians(Cuda, const MedianView& view, Buffer<Crossing, Cuda>& crossings) {
    const int blocks = std::min(kBlocks, view.grid.count());
    crossings.resize(static_cast<std::size_t>(blocks) * kDepthSplats * kTilePixels);
    median_kernel<<<blocks, kThreads>>>(view, crossings.span());
    check_launch();
}

TVSGS_BLEND_CUDA(MeanDepthModel)
TVSGS_BLEND_BACK_CUDA(MedianDepthModel)

}  // namespace tvsgs
