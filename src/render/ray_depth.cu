#include "render/blend_cuda.h"
#include "render/ray_depth.h"

namespace tvsgs {
namespace {

using namespace blend_detail;

/// What all turns of a warp's walk over its list see.
struct Walk {
    const MedianView& in;
    Batch<RayDepthModel>& batch;
    LanePixels pixels;
    std::uint32_t begin;          // of the tile's list
    std::uint32_t stop[kPixels];  // 0: the pixel takes no part

    /// visit(position, alphas, points) for the splats in [from, to) of the list that may draw in
    /// the warp; alpha is 0 at pixels where one does not. Leaves after a batch where full() holds.
    template <class Visit, class Full>
    __device__ void operator()(std::uint32_t from,
                               std::uint32_t to,
                               const Visit& visit,
                               const Full& full) const {
        const std::uint32_t lane = threadIdx.x % 32;
        for (std::uint32_t first = from; first < to && !full(); first += kBatch) {
            const bool has_splat = first + lane < to;
            unsigned mask = load_batch<RayDepthModel>(
                has_splat, has_splat ? in.splats[begin + first + lane] : 0, in.shapes, in.profiles,
                pixels, batch);
            for (; mask != 0; mask &= mask - 1) {
                const int j = __ffs(static_cast<int>(mask)) - 1;
                const std::uint32_t position = first + static_cast<std::uint32_t>(j);
                const SplatShape<float> shape = batch.shapes[j];
                float alphas[kPixels];
                RayPoint<float> points[kPixels];
                RayDepthModel::Hit hits[kPixels];
#pragma unroll
                for (int k = 0; k < kPixels; ++k) {
                    Vec2f d = offset<RayDepthModel>(shape, pixels, k);
                    d.y = position < stop[k] ? d.y : kOutOfReach;
                    hits[k] = RayDepthModel::hit(shape, d);
                }
                if (!__any_sync(kAll, hits[0].alpha > 0 || hits[1].alpha > 0)) continue;
#pragma unroll
                for (int k = 0; k < kPixels; ++k) {
                    alphas[k] = hits[k].alpha;
                    points[k] = ray_point(batch.features[j], hits[k].offset);
                    // All passes, and nothing changes with depth.
                    if (alphas[k] == 0) points[k].inverse = 0;
                }
                visit(position, alphas, points);
            }
            __syncwarp();  // before the next batch overwrites this one
        }
    }
    template <class Visit>
    __device__ void operator()(std::uint32_t from, std::uint32_t to, const Visit& visit) const {
        (*this)(from, to, visit, [] { return false; });
    }
};

/// The part of a list that meets the brackets of a warp's pixels. What lies wholly before the
/// brackets is a factor of T^2, what lies behind is none.
struct Window {
    std::uint32_t from, to;
    float before[kPixels];               // T^2 of what is outside, in front
    std::uint32_t last_before[kPixels];  // of all splats before the bracket; behind it in the list

    // While a turn narrows it.
    std::uint32_t new_from, new_to;
    float leading[kPixels], trailing[kPixels];  // factors outside what has been met so far

    __device__ void begin_turn() {
        new_from = to, new_to = from;
        for (int k = 0; k < kPixels; ++k) leading[k] = trailing[k] = 1;
    }
    __device__ void meet(std::uint32_t position) {
        if (new_to <= new_from) {
            new_from = position;
            for (int k = 0; k < kPixels; ++k) leading[k] = trailing[k];
        }
        new_to = position + 1;
        for (int k = 0; k < kPixels; ++k) trailing[k] = 1;
    }
    __device__ void end_turn() {
        const bool met = new_to > new_from;
        for (int k = 0; k < kPixels; ++k) before[k] *= met ? leading[k] * trailing[k] : trailing[k];
        from = met ? new_from : to, to = met ? new_to : to;
    }
};

using Search = MedianSearch<float>;

/// T^2 at the points of the searches; narrows the window by their brackets.
__device__ void look(const Walk& walk,
                     const Search (&search)[kPixels],
                     Window& window,
                     float (&square)[kPixels][Search::kPoints]) {
    float common[kPixels];
#pragma unroll
    for (int k = 0; k < kPixels; ++k) {
        common[k] = window.before[k];
#pragma unroll
        for (int j = 0; j < Search::kPoints; ++j) square[k][j] = 1;
    }
    window.begin_turn();
    walk(window.from, window.to,
         [&](std::uint32_t position, const float(&alphas)[kPixels],
             const RayPoint<float>(&points)[kPixels]) {
             bool meets = false;
             float passed[kPixels];
#pragma unroll
             for (int k = 0; k < kPixels; ++k) {
                 const float reach = kProfileReach * points[k].deviation;
                 const bool draws = alphas[k] > 0;
                 const bool behind = points[k].depth - reach >= search[k].high,
                            before = points[k].depth + reach <= search[k].low;
                 meets |= draws && !behind && !before;
                 passed[k] = draws && before ? (1 - alphas[k]) * (1 - alphas[k]) : 1.0f;
                 if (draws && before)
                     window.last_before[k] = max(window.last_before[k], position + 1);
             }
             if (!__any_sync(kAll, meets)) {
#pragma unroll
                 for (int k = 0; k < kPixels; ++k)
                     common[k] *= passed[k], window.trailing[k] *= passed[k];
                 return;
             }
             window.meet(position);
#pragma unroll
             for (int k = 0; k < kPixels; ++k)
#pragma unroll
                 for (int j = 0; j < Search::kPoints; ++j)
                     square[k][j] *= passed_square(
                         alphas[k], (search[k].points[j] - points[k].depth) * points[k].inverse);
         });
    window.end_turn();
#pragma unroll
    for (int k = 0; k < kPixels; ++k)
#pragma unroll
        for (int j = 0; j < Search::kPoints; ++j) square[k][j] *= common[k];
}

__global__ void __launch_bounds__(kThreads) median_kernel(MedianView in) {
    // As bytes: a splat's shape has a constructor, and this needs none.
    __shared__ alignas(16) unsigned char batches[kWarps][sizeof(Batch<RayDepthModel>)];
    const LanePixels p = lane_pixels(in.grid);
    Walk walk{in,
              *reinterpret_cast<Batch<RayDepthModel>*>(batches[threadIdx.x / 32]),
              p,
              in.spans[blockIdx.x].begin,
              {}};
    for (int k = 0; k < kPixels; ++k) {
        const int at = p.y[k] * in.grid.width + p.x;
        if (p.inside[k] && in.transmittance[at] <= 0.5f) walk.stop[k] = in.stops[at];
    }
    const std::uint32_t end = warp_maximum(max(walk.stop[0], walk.stop[1]));

    MedianRange<float> ranges[kPixels];
    walk(
        0, end,
        [&](std::uint32_t, const float(&alphas)[kPixels], const RayPoint<float>(&points)[kPixels]) {
#pragma unroll
            for (int k = 0; k < kPixels; ++k) ranges[k].add(alphas[k], points[k]);
        },
        [&] {
            return __all_sync(kAll, (walk.stop[0] == 0 || ranges[0].complete()) &&
                                        (walk.stop[1] == 0 || ranges[1].complete()));
        });

    Search search[kPixels];
    bool open[kPixels];
    Window window{0, end, {1, 1}, {}, 0, 0, {}, {}};
#pragma unroll
    for (int k = 0; k < kPixels; ++k) {
        open[k] = walk.stop[k] > 0;
        search[k].start(ranges[k]);
    }
    for (int turn = 0; turn < Search::kMostTurns && __any_sync(kAll, open[0] || open[1]); ++turn) {
        float square[kPixels][Search::kPoints];
        look(walk, search, window, square);
#pragma unroll
        for (int k = 0; k < kPixels; ++k) {
            if (!open[k]) continue;
            if (!search[k].narrow(square[k])) walk.stop[k] = 0;
            open[k] = walk.stop[k] > 0 && !search[k].done();
            search[k].spread_points();
        }
    }

    float depth[kPixels], slope[kPixels] = {};
    std::uint32_t last[kPixels];
#pragma unroll
    for (int k = 0; k < kPixels; ++k) {
        if (!search[k].found()) walk.stop[k] = 0;
        depth[k] = search[k].median();
        last[k] = window.last_before[k];
    }
    walk(window.from, window.to,
         [&](std::uint32_t position, const float(&alphas)[kPixels],
             const RayPoint<float>(&points)[kPixels]) {
#pragma unroll
             for (int k = 0; k < kPixels; ++k) {
                 const float x = (depth[k] - points[k].depth) * points[k].inverse;
                 slope[k] +=
                     passed_vjp(alphas[k], x, points[k].deviation, points[k].inverse).by_depth;
                 const float reach = kProfileReach * points[k].deviation;
                 if (alphas[k] > 0 && points[k].depth - reach < search[k].high)
                     last[k] = max(last[k], position + 1);
             }
         });
#pragma unroll
    for (int k = 0; k < kPixels; ++k) {
        if (!p.inside[k]) continue;
        const int at = p.y[k] * in.grid.width + p.x;
        const bool found = walk.stop[k] > 0;
        in.depth[at] = found ? depth[k] : 0;
        in.slope[at] = found ? slope[k] : 0;
        in.median_stops[at] = found ? last[k] : 0;
    }
}

}  // namespace

void find_medians(Cuda, const MedianView& view) {
    median_kernel<<<view.grid.count(), kThreads>>>(view);
    check_launch();
}

TVSGS_BLEND_CUDA(MeanDepthModel)
TVSGS_BLEND_BACK_CUDA(MedianDepthModel)

}  // namespace tvsgs
