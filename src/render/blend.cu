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

/// Where pixels go that take no part: all alphas are 0 there, and no flag has to be asked. Products
/// with it stay finite.
constexpr float kOutOfReach = 1e25f;

/// A number that the compiler keeps in a register, and does not compute anew where it is used.
__device__ int kept(int value) {
    asm volatile("" : "+r"(value));
    return value;
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
            // What the set does not hold was never written.
            if constexpr (has_color(kChannels) && has_plane(kChannels))
                batch.features[lane] = features[splat];
            else if constexpr (has_color(kChannels))
                batch.features[lane].f.color = features[splat].f.color;
            else
                batch.features[lane].f.normal = features[splat].f.normal,
                batch.features[lane].f.distance = features[splat].f.distance;
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
    LanePixels p = lane_pixels(grid);
    for (int k = 0; k < kPixels; ++k)
        if (!p.inside[k]) p.centre_y[k] = kOutOfReach;
    const std::uint32_t lane = threadIdx.x % 32;
    const TileSpan span = spans[blockIdx.x];
    PixelForward<float> pixels[kPixels];
    std::uint32_t stop[kPixels] = {};

    // No block barrier: each warp leaves by itself.
    std::uint32_t next = span.begin + lane < span.end ? splats[span.begin + lane] : 0;
    for (std::uint32_t begin = span.begin; begin < span.end; begin += kBatch) {
        if (__all_sync(kAll, p.centre_y[0] == kOutOfReach && p.centre_y[1] == kOutOfReach)) break;
        const std::uint32_t splat = next, ahead = begin + kBatch + lane;
        if (ahead < span.end) next = splats[ahead];
        unsigned mask =
            load_batch<kChannels>(begin + lane < span.end, splat, shapes, features, p, batch);
        for (; mask != 0; mask &= mask - 1) {
            const int j = __ffs(static_cast<int>(mask)) - 1;
            const SplatShape<float> s = batch.shapes[j];
            float alpha[kPixels];
#pragma unroll
            for (int k = 0; k < kPixels; ++k) alpha[k] = splat_alpha(s, offset(s, p, k)).alpha;
            if (!__any_sync(kAll, alpha[0] > 0 || alpha[1] > 0)) continue;
            // No branches but that of the whole warp: an alpha of 0 adds zeros.
            const SplatFeatures<float>& f = batch.features[j].f;
#pragma unroll
            for (int k = 0; k < kPixels; ++k) {
                const bool fits = blend<kChannels>(pixels[k], alpha[k], f);
                if (fits && alpha[k] > 0)
                    stop[k] = begin - span.begin + static_cast<std::uint32_t>(j) + 1;
                if (!fits) p.centre_y[k] = kOutOfReach;
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

/// The values of SplatGradients that a channel set fills, without the gaps.
template <Channels kChannels>
struct FilledValues {
    static constexpr int kCommon = 8;  // up to the opacity, before the features
    static constexpr int kFeatures =
        (has_color(kChannels) ? 3 : 0) + (has_plane(kChannels) ? 4 : 0);
    static constexpr int kCount = kCommon + kFeatures + 1;

    TVSGS_HD static constexpr int member(int v) {
        if (v == kCount - 1) return kValues - 1;
        return v < kCommon || has_color(kChannels) ? v : v + 3;
    }
};

/// One step of halving_sum: of kSize values the upper lanes keep the second half. A template, so
/// that the values stay in registers.
template <int kSize, int kRoom>
__device__ void trade_halves(float (&values)[kRoom], int lane, int distance) {
    constexpr int kHalf = (kSize + 1) / 2;
    const bool upper = lane & distance;
#pragma unroll
    for (int v = 0; v < kHalf; ++v) {
        const float second = v + kHalf < kSize ? values[v + kHalf] : 0;
        const float sent = upper ? values[v] : second;
        const float kept = upper ? second : values[v];
        values[v] = kept + __shfl_xor_sync(kAll, sent, distance);
    }
}

/// Sums 9 to 16 values over the lanes of a warp with little more than as many shuffles: lanes trade
/// halves of the values until each pair holds one, see value_of_lane().
template <int kCount>
__device__ float halving_sum(float (&values)[kCount], int lane) {
    constexpr int kHalf = (kCount + 1) / 2, kQuarterOf = (kHalf + 1) / 2;
    static_assert(kQuarterOf > 2 && kQuarterOf <= 4);
    trade_halves<kCount>(values, lane, 16);
    trade_halves<kHalf>(values, lane, 8);
    trade_halves<kQuarterOf>(values, lane, 4);
    trade_halves<2>(values, lane, 2);
    return values[0] + __shfl_xor_sync(kAll, values[0], 1);
}

/// Which value halving_sum leaves in a lane: each trade's bit says which half was kept; -1 where
/// the halves were uneven and none is left.
template <int kCount>
__device__ int value_of_lane(int lane) {
    int value = 0, left = kCount;
    for (int distance = 16, size = kCount; distance > 1; distance /= 2, size = (size + 1) / 2) {
        const int half = (size + 1) / 2;
        const bool upper = lane & distance;
        value += upper ? half : 0;
        left = upper ? left - half : min(left, half);
    }
    return left > 0 ? value : -1;
}

__device__ std::uint32_t warp_maximum(std::uint32_t value) {
    for (int distance = 16; distance > 0; distance /= 2)
        value = max(value, __shfl_xor_sync(kAll, value, distance));
    return value;
}

struct SlotGradientSpans {
    Span<SplatGradients<float>> gradients;
    Span<std::uint8_t> drawn;
    Span<const std::uint32_t> first_slot;  // of each splat

    /// Adds to a splat's gradients in whatever order warps come; for comparison only.
    __device__ void add_atomically(std::uint32_t splat, int member, float value) const {
        const std::uint32_t slot = first_slot[splat];
        atomicAdd(&gradients[slot].mean.x + member, value);
        drawn[slot] = 1;
    }
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

template <Channels kChannels, bool kAtomic>
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
    using Filled = FilledValues<kChannels>;
    const std::uint32_t warp = threadIdx.x / 32, lane = threadIdx.x % 32;
    // Where this lane writes a value of the warp's first sum; below 0: nowhere.
    const int value = value_of_lane<Filled::kCount>(static_cast<int>(lane));
    const int place = kept(lane % 2 == 0 && value >= 0
                               ? static_cast<int>(warp) * kBatch * kValues + Filled::member(value)
                               : -1);
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
            Vec2f w[kPixels];
#pragma unroll
            for (int k = 0; k < kPixels; ++k) {
                Vec2f d = offset(s, p, k);
                d.y = begin + static_cast<std::uint32_t>(j) < stop[k] ? d.y : kOutOfReach;
                a[k] = splat_alpha(s, d);
                w[k] = whitened(s.root, d);
            }
            const bool draws = a[0].alpha > 0 || a[1].alpha > 0;
            const unsigned lanes = __ballot_sync(kAll, draws);
            if (lanes == 0) continue;
            drawn |= bit;
            // No branches: whatever does not draw adds zeros. To -0 nothing has to be added.
            constexpr float o = -0.0f;
            union {
                SplatGradients<float> g;
                float values[kValues];
            } u{{{o, o}, {o, o}, {o, o, o}, o, {{o, o, o}, {o, o, o}, o}, o}};
#pragma unroll
            for (int k = 0; k < kPixels; ++k) {
                const float T = pixels[k].T;
                blend_vjp<kChannels>(pixels[k], s.root, batch.features[j].f, w[k], a[k], u.g);
                if (a[k].alpha == 0) pixels[k].T = T;  // the inverse of 1 is approximate, too
            }
            if ((lanes & (lanes - 1)) == 0) {  // one lane: nothing to add
                if (draws) {
#pragma unroll
                    for (int v = 0; v < kValues; ++v)
                        if constexpr (kAtomic)
                            out.add_atomically(splats[position + j], v, u.values[v]);
                        else
                            sums.of[warp][j][v] = u.values[v];
                }
                continue;
            }
            float values[Filled::kCount];
#pragma unroll
            for (int v = 0; v < Filled::kCount; ++v) values[v] = u.values[Filled::member(v)];
            const float sum = halving_sum(values, static_cast<int>(lane));
            if (place < 0) continue;
            if constexpr (kAtomic)
                out.add_atomically(splats[position + j], place % kValues, sum);
            else
                (&sums.of[0][0][0])[place + j * kValues] = sum;
        }
        if constexpr (!kAtomic) {
            if (lane == 0) sums.drawn[warp] = drawn;
            // The only barrier: whoever passes the next one has left write_slots() of this turn.
            __syncthreads();
            write_slots(sums, count, slot, out);
        } else {
            __syncwarp();  // before the next batch overwrites this one
        }
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
        PixelWriter<kChannels>(images, state, camera), state.stop.span());
    check_launch();
}

template <Channels kChannels>
void blend_tiles_vjp(const ViewSplats<Cuda>& splats,
                     const TileLists<Cuda>& lists,
                     const TileGrid& grid,
                     const RenderedImages<Cuda>& images,
                     const BlendState<Cuda>& state,
                     const PixelGradientReader<kChannels>& dL_dpixel,
                     SlotGradients<Cuda>& slots) {
    slots.resize(static_cast<std::size_t>(lists.slot_count));
    slots.drawn.fill_zero();
    const SlotGradientSpans out{slots.gradients.span(), slots.drawn.span(),
                                lists.first_slot.span()};
    if (slots.atomic) slots.gradients.fill_zero();
    const auto kernel =
        slots.atomic ? blend_vjp_kernel<kChannels, true> : blend_vjp_kernel<kChannels, false>;
    kernel<<<grid.count(), kThreads>>>(
        splats.shapes.span(), splats.features.span(), lists.slots.span(), lists.splats.span(),
        lists.spans.span(), grid, images.transmittance.span(), state.stop.span(), dL_dpixel, out);
    check_launch();
    if (lists.visible_count == 0 || slots.atomic) return;
    sum_slots_kernel<<<(4 * lists.visible_count + kThreads - 1) / kThreads, kThreads>>>(
        lists.first_slot_by_depth.span(), static_cast<std::uint32_t>(lists.slot_count), out);
    check_launch();
}

#define TVSGS_INSTANTIATE(channels)                                                            \
    template void blend_tiles<channels>(const ViewSplats<Cuda>&, const TileLists<Cuda>&,       \
                                        const TileGrid&, const Camera&, RenderedImages<Cuda>&, \
                                        BlendState<Cuda>&);                                    \
    template void blend_tiles_vjp<channels>(                                                   \
        const ViewSplats<Cuda>&, const TileLists<Cuda>&, const TileGrid&,                      \
        const RenderedImages<Cuda>&, const BlendState<Cuda>&,                                  \
        const PixelGradientReader<channels>&, SlotGradients<Cuda>&);
TVSGS_INSTANTIATE(Channels::color)
TVSGS_INSTANTIATE(Channels::color_plane)
TVSGS_INSTANTIATE(Channels::plane)

}  // namespace tvsgs
