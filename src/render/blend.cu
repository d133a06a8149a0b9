// CUDA twin: one block per tile, a warp per quarter of it, two pixels per lane.
#include "core/parallel.h"
#include "render/blend.h"

namespace tvsgs {
namespace {

constexpr int kQuarter = kTileSize / 2;  // side of a warp's pixels
constexpr int kWarps = 4, kThreads = 32 * kWarps;
constexpr int kPixels = 2;  // of a lane, four rows apart
constexpr int kRowStep = 32 / kQuarter;
constexpr int kBatch = 32;  // splats that a warp tests at once, one per lane
constexpr unsigned kAll = 0xffffffffu;
constexpr int kValues = SplatGradients<float>::kCount;
static_assert(kPixels * kRowStep == kQuarter);

/// Pixels of a lane, and the pixel centres of its warp.
struct LanePixels {
    int x, y[kPixels];
    float centre_x, centre_y[kPixels];
    bool inside[kPixels];
    Vec2f low, high;  // in the image; high < low where the warp has none
};
__device__ LanePixels lane_pixels(const TileGrid& grid) {
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32;
    const int left = blockIdx.x % grid.columns * kTileSize + warp % 2 * kQuarter;
    const int top = blockIdx.x / grid.columns * kTileSize + warp / 2 * kQuarter;
    LanePixels p;
    p.x = left + lane % kQuarter;
    p.centre_x = static_cast<float>(p.x) + 0.5f;
    for (int k = 0; k < kPixels; ++k) {
        p.y[k] = top + lane / kQuarter + k * kRowStep;
        p.centre_y[k] = static_cast<float>(p.y[k]) + 0.5f;
        p.inside[k] = p.x < grid.width && p.y[k] < grid.height;
    }
    p.low = {static_cast<float>(left) + 0.5f, static_cast<float>(top) + 0.5f};
    p.high = {static_cast<float>(min(left + kQuarter, grid.width)) - 0.5f,
              static_cast<float>(min(top + kQuarter, grid.height)) - 0.5f};
    return p;
}

/// From a pixel centre to the mean.
__device__ Vec2f offset(const SplatShape<float>& s, const LanePixels& p, int k) {
    return {s.mean.x - p.centre_x, s.mean.y - p.centre_y[k]};
}

/// The splats of a batch that may draw in the warp's pixels.
struct Batch {
    SplatShape<float> shapes[kBatch];
    FeatureRecord features[kBatch];
};

/// Each lane loads its splat and tests it against the warp's pixels; returns the mask of those that
/// may draw, which then lie in `batch`. Only their features are read.
template <Channels kChannels>
__device__ unsigned load_batch(bool has_splat,
                               std::uint32_t splat,
                               Span<const SplatShape<float>> shapes,
                               Span<const FeatureRecord> features,
                               const LanePixels& p,
                               Batch& batch) {
    const int lane = threadIdx.x % 32;
    bool draws = false;
    if (has_splat) {
        const SplatShape<float> shape = shapes[splat];
        draws = may_draw(shape, p.low, p.high);
        if (draws) {
            batch.shapes[lane] = shape;
            if constexpr (has_plane(kChannels))
                batch.features[lane] = features[splat];
            else
                batch.features[lane].f.color = features[splat].f.color;
        }
    }
    const unsigned mask = __ballot_sync(kAll, draws);
    __syncwarp();
    return mask;
}

template <Channels kChannels>
__global__ void __launch_bounds__(kThreads) blend_kernel(Span<const SplatShape<float>> shapes,
                                                         Span<const FeatureRecord> features,
                                                         Span<const std::uint32_t> splats,
                                                         Span<const TileSpan> spans,
                                                         TileGrid grid,
                                                         PixelWriter<kChannels> write,
                                                         Span<std::uint32_t> stop_out) {
    __shared__ Batch batches[kWarps];
    Batch& batch = batches[threadIdx.x / 32];
    const LanePixels p = lane_pixels(grid);
    const std::uint32_t lane = threadIdx.x % 32;
    const TileSpan span = spans[blockIdx.x];
    PixelForward<float> pixels[kPixels];
    std::uint32_t stop[kPixels] = {};
    bool full[kPixels] = {!p.inside[0], !p.inside[1]};

    // No block barrier: each warp leaves by itself.
    std::uint32_t next = span.begin + lane < span.end ? splats[span.begin + lane] : 0;
    for (std::uint32_t begin = span.begin; begin < span.end; begin += kBatch) {
        if (__all_sync(kAll, full[0] && full[1])) break;
        const std::uint32_t splat = next, ahead = begin + kBatch + lane;
        if (ahead < span.end) next = splats[ahead];
        unsigned mask =
            load_batch<kChannels>(begin + lane < span.end, splat, shapes, features, p, batch);
        for (; mask != 0; mask &= mask - 1) {
            const int j = __ffs(static_cast<int>(mask)) - 1;
            const SplatShape<float> s = batch.shapes[j];
            float alpha[kPixels];
#pragma unroll
            for (int k = 0; k < kPixels; ++k)
                alpha[k] = full[k] ? 0 : splat_alpha(s, offset(s, p, k)).alpha;
            if (alpha[0] == 0 && alpha[1] == 0) continue;
            const SplatFeatures<float>& f = batch.features[j].f;
#pragma unroll
            for (int k = 0; k < kPixels; ++k) {
                if (alpha[k] == 0) continue;
                if (blend<kChannels>(pixels[k], alpha[k], f))
                    stop[k] = begin - span.begin + static_cast<std::uint32_t>(j) + 1;
                else
                    full[k] = true;
            }
        }
        __syncwarp();  // before the next batch overwrites this one
    }
    for (int k = 0; k < kPixels; ++k)
        if (p.inside[k]) {
            write(p.x, p.y[k], pixels[k]);
            stop_out[p.y[k] * grid.width + p.x] = stop[k];
        }
}

/// One step of halving_sum. A template, so that the values stay in registers.
template <int kHalf>
__device__ void trade_halves(float (&values)[kValues], int lane) {
    constexpr int kDistance = 2 * kHalf;
    const bool upper = lane & kDistance;
#pragma unroll
    for (int v = 0; v < kHalf; ++v) {
        const float sent = upper ? values[v] : values[v + kHalf];
        const float kept = upper ? values[v + kHalf] : values[v];
        values[v] = kept + __shfl_xor_sync(kAll, sent, kDistance);
    }
}

/// Sums 16 values over the lanes of a warp with 16 shuffles: lanes trade halves of the values until
/// each pair holds one. On return value v's sum is in `values[0]` of lanes 2v' and 2v'+1, where v'
/// is given by value_of_lane().
__device__ float halving_sum(float (&values)[kValues], int lane) {
    trade_halves<kValues / 2>(values, lane);
    trade_halves<kValues / 4>(values, lane);
    trade_halves<kValues / 8>(values, lane);
    trade_halves<kValues / 16>(values, lane);
    return values[0] + __shfl_xor_sync(kAll, values[0], 1);
}

/// Which value halving_sum leaves in a lane: each trade's bit says which half was kept.
__device__ int value_of_lane(int lane) {
    return (lane & 16 ? 8 : 0) + (lane & 8 ? 4 : 0) + (lane & 4 ? 2 : 0) + (lane & 2 ? 1 : 0);
}

__device__ std::uint32_t warp_maximum(std::uint32_t value) {
    for (int distance = 16; distance > 0; distance /= 2)
        value = max(value, __shfl_xor_sync(kAll, value, distance));
    return value;
}

struct SlotGradientSpans {
    Span<SplatGradients<float>> gradients;
    Span<std::uint8_t> drawn;
};

/// Sums of each warp over its pixels, for one batch.
struct alignas(16) BatchSums {
    float of[kWarps][kBatch][kValues];
    unsigned drawn[kWarps];  // splats that drew in the warp; the others' sums are not written
};

/// Adds the warps' sums in fixed order and writes the slots; four lanes write the 64 bytes of one.
__device__ void write_slots(const BatchSums& sums,
                            int count,
                            std::uint32_t slot,
                            const SlotGradientSpans& out) {
    static_assert(kThreads == kBatch * kValues / 4);
    const int j = threadIdx.x / 4, part = threadIdx.x % 4;
    if (j >= count) return;
    float4 sum{};
    bool drawn = false;
#pragma unroll
    for (int warp = 0; warp < kWarps; ++warp)
        if (sums.drawn[warp] >> j & 1) {
            const float4 s = *reinterpret_cast<const float4*>(&sums.of[warp][j][4 * part]);
            sum.x += s.x, sum.y += s.y, sum.z += s.z, sum.w += s.w;
            drawn = true;
        }
    if (!drawn) return;
    reinterpret_cast<float4*>(&out.gradients[slot])[part] = sum;
    if (part == 0) out.drawn[slot] = 1;
}

template <Channels kChannels>
__global__ void __launch_bounds__(kThreads) blend_vjp_kernel(Span<const SplatShape<float>> shapes,
                                                             Span<const FeatureRecord> features,
                                                             Span<const std::uint32_t> slots,
                                                             Span<const std::uint32_t> splats,
                                                             Span<const TileSpan> spans,
                                                             TileGrid grid,
                                                             Span<const float> transmittance,
                                                             Span<const std::uint32_t> stops,
                                                             PixelGradientReader<kChannels> read,
                                                             SlotGradientSpans out) {
    __shared__ Batch batches[kWarps];
    __shared__ BatchSums sums_of_two[2];  // one is filled while the other is written out
    __shared__ std::uint32_t last_of_warp[kWarps];
    const std::uint32_t warp = threadIdx.x / 32, lane = threadIdx.x % 32;
    Batch& batch = batches[warp];
    const LanePixels p = lane_pixels(grid);
    const TileSpan span = spans[blockIdx.x];
    PixelBackward<float> pixels[kPixels];
    std::uint32_t stop[kPixels];
    for (int k = 0; k < kPixels; ++k) {
        const int at = p.y[k] * grid.width + p.x;
        pixels[k] = {p.inside[k] ? transmittance[at] : 1.0f,
                     p.inside[k] ? read(at) : SplatFeatures<float>{}};
        stop[k] = p.inside[k] ? stops[at] : 0;
    }
    // The warp starts from its last contributor, the block from the last of all.
    const std::uint32_t warp_last = warp_maximum(max(stop[0], stop[1]));
    if (lane == 0) last_of_warp[warp] = warp_last;
    __syncthreads();
    std::uint32_t end = 0;
    for (int w = 0; w < kWarps; ++w) end = max(end, last_of_warp[w]);

    for (int turn = 0; end > 0; turn ^= 1) {
        const std::uint32_t begin = end > kBatch ? end - kBatch : 0;
        const int count = static_cast<int>(end - begin);
        BatchSums& sums = sums_of_two[turn];
        const std::uint32_t position = span.begin + begin;
        const std::uint32_t slot =  // for write_slots()
            threadIdx.x / 4 < count ? slots[position + threadIdx.x / 4] : 0;
        const bool has_splat = begin + lane < min(end, warp_last);
        unsigned mask = load_batch<kChannels>(has_splat, has_splat ? splats[position + lane] : 0,
                                              shapes, features, p, batch);
        unsigned drawn = 0;
        while (mask != 0) {
            const int j = 31 - __clz(static_cast<int>(mask));
            const unsigned bit = 1u << j;
            mask ^= bit;
            const SplatShape<float> s = batch.shapes[j];
            SplatAlpha<float> a[kPixels];
#pragma unroll
            for (int k = 0; k < kPixels; ++k)
                a[k] = begin + static_cast<std::uint32_t>(j) < stop[k]
                           ? splat_alpha(s, offset(s, p, k))
                           : SplatAlpha<float>{0, 0};
            const bool draws = a[0].alpha > 0 || a[1].alpha > 0;
            const unsigned lanes = __ballot_sync(kAll, draws);
            if (lanes == 0) continue;
            drawn |= bit;
            union {
                SplatGradients<float> g;
                float values[kValues];
            } u{SplatGradients<float>{}};
            if (draws) {
#pragma unroll
                for (int k = 0; k < kPixels; ++k)
                    if (a[k].alpha > 0)
                        blend_vjp<kChannels>(pixels[k], s, batch.features[j].f, offset(s, p, k),
                                             a[k], u.g);
            }
            if ((lanes & (lanes - 1)) == 0) {  // one lane: nothing to add
                if (draws) {
#pragma unroll
                    for (int v = 0; v < kValues; ++v) sums.of[warp][j][v] = u.values[v];
                }
                continue;
            }
            const float sum = halving_sum(u.values, static_cast<int>(lane));
            if (lane % 2 == 0) sums.of[warp][j][value_of_lane(static_cast<int>(lane))] = sum;
        }
        if (lane == 0) sums.drawn[warp] = drawn;
        // The only barrier: whoever passes the next one has left write_slots() of this turn.
        __syncthreads();
        write_slots(sums, count, slot, out);
        end = begin;
    }
}

__device__ void add(float4& sum, const float4& value) {
    sum.x += value.x, sum.y += value.y, sum.z += value.z, sum.w += value.w;
}

/// Adds up the slots of each splat into its first one. Four lanes hold the 16 values of a splat;
/// all lanes of the warp share in a splat of many slots. The shape of the sums is fixed.
__global__ void __launch_bounds__(kThreads) sum_slots_kernel(Span<const std::uint32_t> first_slots,
                                                             std::uint32_t slot_count,
                                                             SlotGradientSpans slots) {
    constexpr std::uint32_t kLaneSlots = 32;
    const std::uint32_t lane = threadIdx.x % 32, part = lane % 4, group = lane / 4;
    const std::uint32_t rank = (blockIdx.x * kThreads + threadIdx.x) / 4;
    const bool has_splat = rank < first_slots.count;
    const std::uint32_t first = has_splat ? first_slots[rank] : 0;
    const std::uint32_t end = !has_splat                     ? 0
                              : rank + 1 < first_slots.count ? first_slots[rank + 1]
                                                             : slot_count;
    float4 sum{};
    bool drawn = false;
    const auto value = [&](std::uint32_t slot) -> float4& {
        return reinterpret_cast<float4*>(&slots.gradients[slot])[part];
    };
    if (end - first > 1 && end - first <= kLaneSlots) {  // with one slot there is nothing to do
        for (std::uint32_t slot = first; slot < end; ++slot)
            if (slots.drawn[slot]) add(sum, value(slot)), drawn = true;
    }
    __syncwarp();  // all four lanes have read what is overwritten now
    if (drawn) value(first) = sum;
    if (drawn && part == 0) slots.drawn[first] = 1;
    for (unsigned large = __ballot_sync(kAll, part == 0 && end - first > kLaneSlots); large != 0;
         large &= large - 1) {
        const int source = __ffs(static_cast<int>(large)) - 1;
        const std::uint32_t begin = __shfl_sync(kAll, first, source);
        const std::uint32_t stop = __shfl_sync(kAll, end, source);
        sum = {};
        drawn = false;
        for (std::uint32_t slot = begin + group; slot < stop; slot += 8)
            if (slots.drawn[slot]) add(sum, value(slot)), drawn = true;
        for (int distance = 16; distance >= 4; distance /= 2)
            add(sum,
                {__shfl_xor_sync(kAll, sum.x, distance), __shfl_xor_sync(kAll, sum.y, distance),
                 __shfl_xor_sync(kAll, sum.z, distance), __shfl_xor_sync(kAll, sum.w, distance)});
        if (__any_sync(kAll, drawn) && group == 0) {
            value(begin) = sum;
            if (part == 0) slots.drawn[begin] = 1;
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
        splats.shapes.span(), splats.features.span(), lists.splats.span(), lists.spans.span(), grid,
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
                     SlotGradients<Cuda>& slots) {
    slots.resize(static_cast<std::size_t>(lists.slot_count));
    slots.drawn.fill_zero();
    const SlotGradientSpans out{slots.gradients.span(), slots.drawn.span()};
    blend_vjp_kernel<kChannels><<<grid.count(), kThreads>>>(
        splats.shapes.span(), splats.features.span(), lists.slots.span(), lists.splats.span(),
        lists.spans.span(), grid, images.transmittance.span(), state.stop.span(),
        PixelGradientReader<kChannels>{dL_dimages.color.span(), dL_dimages.normal.span(),
                                       dL_dimages.distance.span()},
        out);
    check_launch();
    if (lists.visible_count == 0) return;
    sum_slots_kernel<<<(4 * lists.visible_count + kThreads - 1) / kThreads, kThreads>>>(
        lists.first_slot_by_depth.span(), static_cast<std::uint32_t>(lists.slot_count), out);
    check_launch();
}

#define TVSGS_INSTANTIATE(channels)                                                               \
    template void blend_tiles<channels>(const ViewSplats<Cuda>&, const TileLists<Cuda>&,          \
                                        const TileGrid&, const Camera&, RenderedImages<Cuda>&,    \
                                        BlendState<Cuda>&);                                       \
    template void blend_tiles_vjp<channels>(const ViewSplats<Cuda>&, const TileLists<Cuda>&,      \
                                            const TileGrid&, const RenderedImages<Cuda>&,         \
                                            const BlendState<Cuda>&, const ImageGradients<Cuda>&, \
                                            SlotGradients<Cuda>&);
TVSGS_INSTANTIATE(Channels::color)
TVSGS_INSTANTIATE(Channels::color_plane)
TVSGS_INSTANTIATE(Channels::plane)

}  // namespace tvsgs
