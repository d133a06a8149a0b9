// CUDA twin: one block per tile, one pixel per thread, a warp per 8x4 pixels.
#include "core/parallel.h"
#include "render/blend.h"

namespace tvsgs {
namespace {

constexpr int kThreads = kTileSize * kTileSize;
constexpr int kWarps = kThreads / 32;
constexpr int kSubWidth = 8, kSubHeight = 4;  // pixels of a warp
constexpr unsigned kAll = 0xffffffffu;
constexpr int kValues = SplatGradients<float>::kCount;

struct ThreadPixel {
    int x, y;
    float warp_x, warp_y;  // middle of the warp's pixels
    bool inside;
};
__device__ ThreadPixel thread_pixel(const TileGrid& grid) {
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32;
    const int left = blockIdx.x % grid.columns * kTileSize + warp % 2 * kSubWidth;
    const int top = blockIdx.x / grid.columns * kTileSize + warp / 2 * kSubHeight;
    const int x = left + lane % kSubWidth, y = top + lane / kSubWidth;
    return {x, y, static_cast<float>(left) + 0.5f * kSubWidth,
            static_cast<float>(top) + 0.5f * kSubHeight, x < grid.width && y < grid.height};
}

/// Whether a splat's box can reach a pixel of the warp; the same for all its lanes.
__device__ bool box_meets_warp(const SplatShape<float>& s, const ThreadPixel& p) {
    return fabsf(s.mean.x - p.warp_x) <= s.extent.x + 0.5f * (kSubWidth - 1) &&
           fabsf(s.mean.y - p.warp_y) <= s.extent.y + 0.5f * (kSubHeight - 1);
}

__device__ Vec2f offset(const SplatShape<float>& s, const ThreadPixel& p) {
    return {s.mean.x - (static_cast<float>(p.x) + 0.5f),
            s.mean.y - (static_cast<float>(p.y) + 0.5f)};
}

template <Channels kChannels>
__global__ void __launch_bounds__(kThreads) blend_kernel(Span<const SplatShape<float>> shapes,
                                                         Span<const SplatFeatures<float>> features,
                                                         Span<const std::uint32_t> slots,
                                                         Span<const std::uint32_t> splat_of_slot,
                                                         Span<const TileSpan> spans,
                                                         TileGrid grid,
                                                         PixelWriter<kChannels> write,
                                                         Span<std::uint32_t> stop_out) {
    __shared__ SplatShape<float> batch_shapes[kThreads];
    __shared__ SplatFeatures<float> batch_features[kThreads];
    const ThreadPixel p = thread_pixel(grid);
    const TileSpan span = spans[blockIdx.x];
    PixelForward<float> pixel;
    std::uint32_t stop = 0;
    bool full = !p.inside;

    for (std::uint32_t begin = span.begin; begin < span.end; begin += kThreads) {
        if (__syncthreads_count(full) == kThreads)
            break;  // also guards the batch of the round before
        if (begin + threadIdx.x < span.end) {
            const std::uint32_t splat = splat_of_slot[slots[begin + threadIdx.x]];
            batch_shapes[threadIdx.x] = shapes[splat];
            batch_features[threadIdx.x] = features[splat];
        }
        __syncthreads();
        const int count =
            static_cast<int>(span.end - begin < kThreads ? span.end - begin : kThreads);
        for (int j = 0; j < count && !__all_sync(kAll, full); ++j) {
            const SplatShape<float>& s = batch_shapes[j];
            if (!box_meets_warp(s, p) || full) continue;
            const float alpha = splat_alpha(s, offset(s, p)).alpha;
            if (alpha == 0) continue;
            if (blend<kChannels>(pixel, alpha, batch_features[j]))
                stop = begin - span.begin + static_cast<std::uint32_t>(j) + 1;
            else
                full = true;
        }
    }
    if (p.inside) {
        write(p.x, p.y, pixel);
        stop_out[p.y * grid.width + p.x] = stop;
    }
}

/// Sums 16 values over the lanes of a warp with 16 shuffles: lanes trade halves of the values until
/// each pair holds one. On return value v's sum is in `values[0]` of lanes 2v' and 2v'+1, where v'
/// is given by value_of_lane().
__device__ float halving_sum(float (&values)[kValues], int lane) {
#pragma unroll
    for (int half = kValues / 2, distance = 16; half >= 1; half /= 2, distance /= 2) {
        const bool upper = lane & distance;
#pragma unroll
        for (int v = 0; v < half; ++v) {
            const float sent = upper ? values[v] : values[v + half];
            const float kept = upper ? values[v + half] : values[v];
            values[v] = kept + __shfl_xor_sync(kAll, sent, distance);
        }
    }
    return values[0] + __shfl_xor_sync(kAll, values[0], 1);
}

/// Which value halving_sum leaves in a lane: each trade's bit says which half was kept.
__device__ int value_of_lane(int lane) {
    return (lane & 16 ? 8 : 0) + (lane & 8 ? 4 : 0) + (lane & 4 ? 2 : 0) + (lane & 2 ? 1 : 0);
}

template <Channels kChannels>
__global__ void __launch_bounds__(kThreads)
    blend_vjp_kernel(Span<const SplatShape<float>> shapes,
                     Span<const SplatFeatures<float>> features,
                     Span<const std::uint32_t> slots,
                     Span<const std::uint32_t> splat_of_slot,
                     Span<const TileSpan> spans,
                     TileGrid grid,
                     Span<const float> transmittance,
                     Span<const std::uint32_t> stops,
                     PixelGradientReader<kChannels> read,
                     Span<SplatGradients<float>> slot_gradients) {
    constexpr int kBatch = 32;
    __shared__ SplatShape<float> batch_shapes[kBatch];
    __shared__ SplatFeatures<float> batch_features[kBatch];
    __shared__ std::uint32_t batch_slots[kBatch];
    __shared__ float sums[kWarps][kBatch][kValues];
    __shared__ std::uint32_t hit_mask[kWarps];  // splats of the batch that the warp contributed to
    __shared__ std::uint32_t last_shared;

    const ThreadPixel p = thread_pixel(grid);
    const int lane = threadIdx.x % 32, warp = threadIdx.x / 32;
    const TileSpan span = spans[blockIdx.x];
    const int at = p.y * grid.width + p.x;
    const std::uint32_t stop = p.inside ? stops[at] : 0;
    PixelBackward<float> pixel{
        p.inside ? transmittance[at] : 1.0f, p.inside ? read(at) : SplatFeatures<float>{}, {}};

    if (threadIdx.x == 0) last_shared = 0;
    __syncthreads();
    atomicMax(&last_shared, stop);  // an integer maximum: the order does not matter
    __syncthreads();
    const std::uint32_t last = last_shared;

    for (std::uint32_t end = last; end > 0; end = end > kBatch ? end - kBatch : 0) {
        const std::uint32_t begin = end > kBatch ? end - kBatch : 0;
        const int count = static_cast<int>(end - begin);
        __syncthreads();
        if (threadIdx.x < count) {
            const std::uint32_t slot = slots[span.begin + begin + threadIdx.x];
            const std::uint32_t splat = splat_of_slot[slot];
            batch_slots[threadIdx.x] = slot;
            batch_shapes[threadIdx.x] = shapes[splat];
            batch_features[threadIdx.x] = features[splat];
        }
        __syncthreads();
        std::uint32_t hits = 0;
        for (int j = count - 1; j >= 0; --j) {
            const SplatShape<float>& s = batch_shapes[j];
            if (!box_meets_warp(s, p)) continue;
            union {
                SplatGradients<float> g;
                float values[kValues];
            } u{SplatGradients<float>{}};
            bool contributes = false;
            if (begin + static_cast<std::uint32_t>(j) < stop) {
                const Vec2f d = offset(s, p);
                const SplatAlpha<float> a = splat_alpha(s, d);
                if (a.alpha > 0) {
                    contributes = true;
                    blend_vjp<kChannels>(pixel, s, batch_features[j], d, a, u.g);
                }
            }
            if (!__any_sync(kAll, contributes)) continue;
            const float sum = halving_sum(u.values, lane);
            if (lane % 2 == 0) sums[warp][j][value_of_lane(lane)] = sum;
            hits |= 1u << j;
        }
        if (lane == 0) hit_mask[warp] = hits;
        __syncthreads();
        // The warps' sums in fixed order; 16 consecutive threads write the 64 bytes of one slot.
        for (int v = threadIdx.x; v < count * kValues; v += kThreads) {
            const int j = v / kValues;
            float sum = 0;
            for (int w = 0; w < kWarps; ++w)
                if (hit_mask[w] >> j & 1) sum += sums[w][j][v % kValues];
            reinterpret_cast<float*>(&slot_gradients[batch_slots[j]])[v % kValues] = sum;
        }
    }
}

}  // namespace

template <Channels kChannels>
void blend_tiles(const ViewSplats<Cuda>& splats,
                 const TileLists<Cuda>& lists,
                 const TileGrid& grid,
                 const Camera& camera,
                 RenderedImages<Cuda>& images,
                 BlendState<Cuda>& state) {
    blend_kernel<kChannels><<<grid.count(), kThreads>>>(
        splats.shapes.span(), splats.features.span(), lists.slots.span(),
        lists.splat_of_slot.span(), lists.spans.span(), grid,
        PixelWriter<kChannels>(images, camera), state.stop.span());
    check_launch();
}

template <Channels kChannels>
void blend_tiles_vjp(const ViewSplats<Cuda>& splats,
                     const TileLists<Cuda>& lists,
                     const TileGrid& grid,
                     const RenderedImages<Cuda>& images,
                     const BlendState<Cuda>& state,
                     const ImageGradients<Cuda>& dL_dimages,
                     Buffer<SplatGradients<float>, Cuda>& slot_gradients) {
    slot_gradients.resize(lists.slot_count);
    slot_gradients.fill_zero();
    blend_vjp_kernel<kChannels><<<grid.count(), kThreads>>>(
        splats.shapes.span(), splats.features.span(), lists.slots.span(),
        lists.splat_of_slot.span(), lists.spans.span(), grid, images.transmittance.span(),
        state.stop.span(),
        PixelGradientReader<kChannels>{dL_dimages.color.span(), dL_dimages.normal.span(),
                                       dL_dimages.distance.span()},
        slot_gradients.span());
    check_launch();
}

#define TVSGS_INSTANTIATE(channels)                                                               \
    template void blend_tiles<channels>(const ViewSplats<Cuda>&, const TileLists<Cuda>&,          \
                                        const TileGrid&, const Camera&, RenderedImages<Cuda>&,    \
                                        BlendState<Cuda>&);                                       \
    template void blend_tiles_vjp<channels>(const ViewSplats<Cuda>&, const TileLists<Cuda>&,      \
                                            const TileGrid&, const RenderedImages<Cuda>&,         \
                                            const BlendState<Cuda>&, const ImageGradients<Cuda>&, \
                                            Buffer<SplatGradients<float>, Cuda>&);
TVSGS_INSTANTIATE(Channels::color)
TVSGS_INSTANTIATE(Channels::color_plane)
TVSGS_INSTANTIATE(Channels::plane)

}  // namespace tvsgs
