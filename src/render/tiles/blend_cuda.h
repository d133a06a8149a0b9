// CUDA version of blending, for the .cu file of a model: one block per tile, one warp per quarter
// of it, two pixels per lane. For nvcc only.
#pragma once

#include <bit>

#include "core/device/parallel.h"
#include "render/tiles/blend.h"

namespace tvsgs {
namespace blend_detail {

inline constexpr int kQuarter = kTileSize / 2;  // side of a warp's pixels
inline constexpr int kWarps = 4, kThreads = 32 * kWarps;
inline constexpr int kPixels = 2;  // of a lane, four rows apart
inline constexpr int kRowStep = 32 / kQuarter;
inline constexpr int kBatch = 32;  // splats that a warp tests at once, one per lane
inline constexpr unsigned kAll = 0xffffffffu;
static_assert(kPixels * kRowStep == kQuarter);

/// Pixels of a lane, and the pixel centres of its warp.
struct LanePixels {
    int x, y[kPixels];
    float centre_x, centre_y[kPixels];
    bool inside[kPixels];
    Vec2f low, high;  // inside the image; high < low if the warp has none
};
__device__ inline LanePixels lane_pixels(const TileGrid& grid, unsigned tile) {
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32;
    const int left = tile % grid.columns * kTileSize + warp % 2 * kQuarter;
    const int top = tile / grid.columns * kTileSize + warp / 2 * kQuarter;
    LanePixels p;
    p.x = left + lane % kQuarter;
    p.centre_x = float(p.x) + 0.5f;
    for (int k = 0; k < kPixels; ++k) {
        p.y[k] = top + lane / kQuarter + k * kRowStep;
        p.centre_y[k] = float(p.y[k]) + 0.5f;
        p.inside[k] = p.x < grid.width && p.y[k] < grid.height;
    }
    p.low = {float(left) + 0.5f, float(top) + 0.5f};
    p.high = {float(min(left + kQuarter, grid.width)) - 0.5f,
              float(min(top + kQuarter, grid.height)) - 0.5f};
    return p;
}

/// Keeps a number in a register, so that the compiler does not recompute it.
__device__ inline int kept(int value) {
    asm volatile("" : "+r"(value));
    return value;
}

template <class Model>
__device__ Vec2f offset(const typename Model::Shape& shape, const LanePixels& p, int k) {
    return Model::offset(shape, {p.centre_x, p.centre_y[k]});
}

/// The splats of a batch that may draw in the warp's pixels.
template <class Model>
struct Batch {
    typename Model::Shape shapes[kBatch];
    typename Model::Features features[kBatch];
};

/// Each lane loads its splat and tests it against the warp's pixels. Returns the mask of the splats
/// that may draw and stores them in `batch`; reads only their features.
template <class Model>
__device__ unsigned load_batch(bool has_splat,
                               std::uint32_t splat,
                               Span<const typename Model::Shape> shapes,
                               Span<const typename Model::Features> features,
                               const LanePixels& p,
                               Batch<Model>& batch) {
    const int lane = threadIdx.x % 32;
    bool draws = false;
    if (has_splat) {
        const typename Model::Shape shape = shapes[splat];
        draws = may_draw(shape, p.low, p.high);
        if (draws) {
            batch.shapes[lane] = shape;
            Model::copy(features[splat], batch.features[lane]);
        }
    }
    const unsigned mask = __ballot_sync(kAll, draws);
    __syncwarp();
    return mask;
}

template <class Model>
__global__ void __launch_bounds__(kThreads)
    blend_kernel(Span<const typename Model::Shape> shapes,
                 Span<const typename Model::Features> features,
                 Span<const std::uint32_t> splats,
                 Span<const TileSpan> spans,
                 Span<const std::uint32_t> longest_first,
                 TileGrid grid,
                 typename Model::Writer write,
                 Span<std::uint32_t> stop_out) {
    __shared__ Batch<Model> batches[kWarps];
    Batch<Model>& batch = batches[threadIdx.x / 32];
    const std::uint32_t tile = longest_first[blockIdx.x];
    LanePixels p = lane_pixels(grid, tile);
    for (int k = 0; k < kPixels; ++k)
        if (!p.inside[k]) p.centre_y[k] = kOutOfReach;
    const std::uint32_t lane = threadIdx.x % 32;
    const TileSpan span = spans[tile];
    typename Model::PixelForward pixels[kPixels] = {};
    std::uint32_t stop[kPixels] = {};

    // No block barrier: each warp leaves by itself.
    std::uint32_t next = span.begin + lane < span.end ? splats[span.begin + lane] : 0;
    for (std::uint32_t begin = span.begin; begin < span.end; begin += kBatch) {
        if (__all_sync(kAll, p.centre_y[0] == kOutOfReach && p.centre_y[1] == kOutOfReach)) break;
        const std::uint32_t splat = next, ahead = begin + kBatch + lane;
        if (ahead < span.end) next = splats[ahead];
        unsigned mask =
            load_batch<Model>(begin + lane < span.end, splat, shapes, features, p, batch);
        for (; mask != 0; mask &= mask - 1) {
            const int j = __ffs(int(mask)) - 1;
            const typename Model::Shape s = batch.shapes[j];
            typename Model::Hit hits[kPixels];
#pragma unroll
            for (int k = 0; k < kPixels; ++k) hits[k] = Model::hit(s, offset<Model>(s, p, k));
            if (!__any_sync(kAll, hits[0].alpha > 0 || hits[1].alpha > 0)) continue;
            // Branches only for the whole warp: an alpha of 0 adds zeros.
            const typename Model::Features& f = batch.features[j];
#pragma unroll
            for (int k = 0; k < kPixels; ++k) {
                const bool fits = Model::blend(pixels[k], hits[k], f);
                if (fits && hits[k].alpha > 0) stop[k] = begin - span.begin + std::uint32_t(j) + 1;
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

/// One step of halving_sum(): the upper lanes keep the second half of the kSize values. A template,
/// so that the values stay in registers.
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

/// Sums up to 32 values over the lanes of a warp with little more than 32 shuffles. Lanes trade
/// halves of the values until each has one value, then the lanes of each value add theirs; see
/// value_of_lane(). The sum is in values[0].
template <int kSize, int kDistance = 16, int kRoom>
__device__ void halving_sum(float (&values)[kRoom], int lane) {
    static_assert(kRoom <= 32);
    if constexpr (kSize > 1)
        trade_halves<kSize>(values, lane, kDistance);
    else
        values[0] += __shfl_xor_sync(kAll, values[0], kDistance);
    if constexpr (kDistance > 1) halving_sum<(kSize + 1) / 2, kDistance / 2>(values, lane);
}

/// Index of the value that halving_sum() leaves in a lane. The bit of each trade tells the half
/// that was kept. -1 if the halves were uneven and the lane has none.
template <int kCount>
__device__ int value_of_lane(int lane) {
    int value = 0, left = kCount;
    for (int distance = 16, size = kCount; size > 1; distance /= 2, size = (size + 1) / 2) {
        const int half = (size + 1) / 2;
        const bool upper = lane & distance;
        value += upper ? half : 0;
        left = upper ? left - half : min(left, half);
    }
    return left > 0 ? value : -1;
}
/// Number of adjacent lanes with the same value.
template <int kCount>
inline constexpr unsigned kLanesOfValue = 32 / std::bit_ceil(static_cast<unsigned>(kCount));

__device__ inline std::uint32_t warp_maximum(std::uint32_t value) {
    for (int distance = 16; distance > 0; distance /= 2)
        value = max(value, __shfl_xor_sync(kAll, value, distance));
    return value;
}

template <class Gradients>
struct FragmentGradientSpans {
    Span<Gradients> gradients;
    Span<std::uint8_t> drawn;
};

/// Sums of each warp over its pixels, for one batch.
template <class Gradients>
struct alignas(16) BatchSums {
    static constexpr unsigned kWords = Gradients::kCount / 4;  // of 16 bytes, per splat
    static constexpr int kTurns = (kBatch * kWords + kThreads - 1) / kThreads;

    float of[kWarps][kBatch][Gradients::kCount];
    unsigned drawn[kWarps];  // splats that drew in the warp; sums of the others are not written

    /// The splat whose sums this thread adds in a turn; not below the batch's size: none.
    __device__ static int splat_of_turn(int turn) {
        return int((threadIdx.x + turn * kThreads) / kWords);
    }
};

/// Adds the warps' sums in a fixed order and writes the fragments. In each turn a thread writes 16
/// bytes of one.
template <class Gradients>
__device__ void write_fragments(const BatchSums<Gradients>& sums,
                                int count,
                                const std::uint32_t (&fragments)[BatchSums<Gradients>::kTurns],
                                const FragmentGradientSpans<Gradients>& out) {
    using Sums = BatchSums<Gradients>;
#pragma unroll
    for (int turn = 0; turn < Sums::kTurns; ++turn) {
        const int j = Sums::splat_of_turn(turn),
                  part = (threadIdx.x + turn * kThreads) % Sums::kWords;
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
        if (!drawn) continue;
        reinterpret_cast<float4*>(&out.gradients[fragments[turn]])[part] = sum;
        if (part == 0) out.drawn[fragments[turn]] = 1;
    }
}

template <class Model>
__global__ void __launch_bounds__(kThreads)
    blend_vjp_kernel(Span<const typename Model::Shape> shapes,
                     Span<const typename Model::Features> features,
                     Span<const std::uint32_t> fragments,
                     Span<const std::uint32_t> splats,
                     Span<const TileSpan> spans,
                     Span<const std::uint32_t> longest_first,
                     TileGrid grid,
                     Span<const float> transmittance,
                     Span<const std::uint32_t> stops,
                     typename Model::Reader read,
                     FragmentGradientSpans<typename Model::Gradients> out) {
    using Gradients = typename Model::Gradients;
    using Sums = BatchSums<Gradients>;
    constexpr int kValues = Gradients::kCount, kFilled = Model::kFilled;
    __shared__ Batch<Model> batches[kWarps];
    __shared__ Sums sums_of_two[2];  // one is filled while the other is written
    __shared__ std::uint32_t last_of_warp[kWarps];
    const std::uint32_t warp = threadIdx.x / 32, lane = threadIdx.x % 32;
    // Index to which this lane writes its value of the warp's first sum; negative: nowhere.
    const int value = value_of_lane<kFilled>(int(lane));
    const int place = kept(lane % kLanesOfValue<kFilled> == 0 && value >= 0
                               ? int(warp) * kBatch * kValues + Model::filled(value)
                               : -1);
    Batch<Model>& batch = batches[warp];
    const std::uint32_t tile = longest_first[blockIdx.x];
    const LanePixels p = lane_pixels(grid, tile);
    const TileSpan span = spans[tile];
    typename Model::PixelBackward pixels[kPixels];
    std::uint32_t stop[kPixels];
    for (int k = 0; k < kPixels; ++k) {
        const int at = p.y[k] * grid.width + p.x;
        pixels[k] = p.inside[k]
                        ? pixel_backward<Model>(read, at, transmittance[at])
                        : typename Model::PixelBackward{1.0f, typename Model::PixelGradient{}};
        stop[k] = p.inside[k] ? stops[at] : 0;
    }
    // The warp starts at its last contributor, the block at the last of all warps.
    const std::uint32_t warp_last = warp_maximum(max(stop[0], stop[1]));
    if (lane == 0) last_of_warp[warp] = warp_last;
    __syncthreads();
    std::uint32_t end = 0;
    for (int w = 0; w < kWarps; ++w) end = max(end, last_of_warp[w]);

    for (int turn = 0; end > 0; turn ^= 1) {
        const std::uint32_t begin = end > kBatch ? end - kBatch : 0;
        const int count = int(end - begin);
        Sums& sums = sums_of_two[turn];
        const std::uint32_t position = span.begin + begin;
        std::uint32_t fragments_to_write[Sums::kTurns];
#pragma unroll
        for (int k = 0; k < Sums::kTurns; ++k)
            fragments_to_write[k] =
                Sums::splat_of_turn(k) < count ? fragments[position + Sums::splat_of_turn(k)] : 0;
        const bool has_splat = begin + lane < min(end, warp_last);
        unsigned mask = load_batch<Model>(has_splat, has_splat ? splats[position + lane] : 0,
                                          shapes, features, p, batch);
        unsigned drawn = 0;
        while (mask != 0) {
            const int j = 31 - __clz(int(mask));
            const unsigned bit = 1u << j;
            mask ^= bit;
            const typename Model::Shape s = batch.shapes[j];
            typename Model::Hit hits[kPixels];
#pragma unroll
            for (int k = 0; k < kPixels; ++k) {
                Vec2f d = offset<Model>(s, p, k);
                d.y = begin + std::uint32_t(j) < stop[k] ? d.y : kOutOfReach;
                hits[k] = Model::hit(s, d);
            }
            const bool draws = hits[0].alpha > 0 || hits[1].alpha > 0;
            const unsigned lanes = __ballot_sync(kAll, draws);
            if (lanes == 0) continue;
            drawn |= bit;
            // No branches: pixels that do not draw add zeros. Starting from -0 avoids an addition.
            union {
                float values[kValues];
                Gradients g;
            } u{{}};
#pragma unroll
            for (int v = 0; v < kValues; ++v) u.values[v] = -0.0f;
#pragma unroll
            for (int k = 0; k < kPixels; ++k) {
                const float T = pixels[k].T;
                Model::blend_vjp(pixels[k], s, batch.features[j], hits[k], u.g);
                if (hits[k].alpha == 0) pixels[k].T = T;  // the inverse of 1 is not exactly 1
            }
            if ((lanes & (lanes - 1)) == 0) {  // one lane: nothing to add
                if (draws) {
#pragma unroll
                    for (int v = 0; v < kValues; ++v) sums.of[warp][j][v] = u.values[v];
                }
                continue;
            }
            float values[kFilled];
#pragma unroll
            for (int v = 0; v < kFilled; ++v) values[v] = u.values[Model::filled(v)];
            halving_sum<kFilled>(values, int(lane));
            if (place >= 0) (&sums.of[0][0][0])[place + j * kValues] = values[0];
        }
        if (lane == 0) sums.drawn[warp] = drawn;
        // The only barrier: a warp that passes the next one has left write_fragments() of this
        // turn.
        __syncthreads();
        write_fragments(sums, count, fragments_to_write, out);
        end = begin;
    }
}

__device__ inline void add(float4& sum, const float4& value) {
    sum.x += value.x, sum.y += value.y, sum.z += value.z, sum.w += value.w;
}

/// Sums the fragments of each splat into its first one. A few lanes hold the values of a splat,
/// four each; the whole warp shares a splat with many fragments. The order of the sums is fixed.
template <class Gradients>
inline constexpr std::uint32_t kSplatLanes = std::bit_ceil(std::uint32_t{Gradients::kCount / 4});
template <class Gradients>
__global__ void __launch_bounds__(kThreads)
    sum_fragments_kernel(Span<const std::uint32_t> first_fragments,
                         std::uint32_t fragment_count,
                         FragmentGradientSpans<Gradients> fragments) {
    constexpr std::uint32_t kLaneFragments = 32, kLanes = kSplatLanes<Gradients>;
    // Lanes beyond the values repeat the work of the last one.
    const std::uint32_t lane = threadIdx.x % 32,
                        part = min(lane % kLanes, Gradients::kCount / 4 - 1u),
                        group = lane / kLanes;
    const std::uint32_t rank = (blockIdx.x * kThreads + threadIdx.x) / kLanes;
    const bool has_splat = rank < first_fragments.count;
    const std::uint32_t first = has_splat ? first_fragments[rank] : 0;
    const std::uint32_t end = !has_splat                         ? 0
                              : rank + 1 < first_fragments.count ? first_fragments[rank + 1]
                                                                 : fragment_count;
    float4 sum{};
    bool drawn = false;
    const auto value = [&](std::uint32_t fragment) -> float4& {
        return reinterpret_cast<float4*>(&fragments.gradients[fragment])[part];
    };
    // A single fragment needs no sum.
    if (end - first > 1 && end - first <= kLaneFragments) {
        for (std::uint32_t fragment = first; fragment < end; ++fragment)
            if (fragments.drawn[fragment]) add(sum, value(fragment)), drawn = true;
    }
    __syncwarp();  // all lanes have read the data that is overwritten now
    if (drawn) value(first) = sum;
    if (drawn && part == 0) fragments.drawn[first] = 1;
    for (unsigned large = __ballot_sync(kAll, part == 0 && end - first > kLaneFragments);
         large != 0; large &= large - 1) {
        const int source = __ffs(int(large)) - 1;
        const std::uint32_t begin = __shfl_sync(kAll, first, source);
        const std::uint32_t stop = __shfl_sync(kAll, end, source);
        sum = {};
        drawn = false;
        for (std::uint32_t fragment = begin + group; fragment < stop; fragment += 32 / kLanes)
            if (fragments.drawn[fragment]) add(sum, value(fragment)), drawn = true;
        for (int distance = 16; distance >= kLanes; distance /= 2)
            add(sum,
                {__shfl_xor_sync(kAll, sum.x, distance), __shfl_xor_sync(kAll, sum.y, distance),
                 __shfl_xor_sync(kAll, sum.z, distance), __shfl_xor_sync(kAll, sum.w, distance)});
        if (__any_sync(kAll, drawn) && group == 0) {
            value(begin) = sum;
            if (part == 0) fragments.drawn[begin] = 1;
        }
    }
}

}  // namespace blend_detail

template <BlendModel Model>
void blend_tiles(const SplatsOf<Model, Cuda>& splats,
                 const TileLists<Cuda>& lists,
                 const TileGrid& grid,
                 const typename Model::Writer& write,
                 Buffer<std::uint32_t, Cuda>& stops) {
    using namespace blend_detail;
    blend_kernel<Model><<<grid.count(), kThreads>>>(
        splats.shapes.span(), splats.features.span(), lists.splats.span(), lists.spans.span(),
        lists.longest_first.span(), grid, write, stops.span());
    check_launch();
}

template <BlendModel Model>
void blend_tiles_vjp(const SplatsOf<Model, Cuda>& splats,
                     const TileLists<Cuda>& lists,
                     const TileGrid& grid,
                     const typename Model::Reader& read,
                     const Buffer<float, Cuda>& transmittance,
                     const Buffer<std::uint32_t, Cuda>& stops,
                     FragmentGradients<Cuda, typename Model::Gradients>& fragments) {
    using namespace blend_detail;
    using Gradients = typename Model::Gradients;
    fragments.resize(lists.fragment_count);
    fragments.drawn.fill_zero();
    const FragmentGradientSpans<Gradients> out{fragments.gradients.span(), fragments.drawn.span()};
    blend_vjp_kernel<Model><<<grid.count(), kThreads>>>(
        splats.shapes.span(), splats.features.span(), lists.fragments.span(), lists.splats.span(),
        lists.spans.span(), lists.longest_first.span(), grid, transmittance.span(), stops.span(),
        read, out);
    check_launch();
    if (lists.visible_count == 0) return;
    constexpr int kLanes = kSplatLanes<Gradients>;
    sum_fragments_kernel<<<(kLanes * lists.visible_count + kThreads - 1) / kThreads, kThreads>>>(
        lists.first_fragment_by_depth.span(), std::uint32_t(lists.fragment_count), out);
    check_launch();
}

/// Instantiates the functions for a model, or only for its backward pass.
#define TVSGS_BLEND_CUDA(Model)                                                            \
    template void blend_tiles<Model>(const SplatsOf<Model, Cuda>&, const TileLists<Cuda>&, \
                                     const TileGrid&, const typename Model::Writer&,       \
                                     Buffer<std::uint32_t, Cuda>&);                        \
    TVSGS_BLEND_BACK_CUDA(Model)
#define TVSGS_BLEND_BACK_CUDA(Model)                                           \
    template void blend_tiles_vjp<Model>(                                      \
        const SplatsOf<Model, Cuda>&, const TileLists<Cuda>&, const TileGrid&, \
        const typename Model::Reader&, const Buffer<float, Cuda>&,             \
        const Buffer<std::uint32_t, Cuda>&, FragmentGradients<Cuda, typename Model::Gradients>&);

}  // namespace tvsgs
