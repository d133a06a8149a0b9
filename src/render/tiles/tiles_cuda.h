// CUDA version of the tile lists, for the .cu file of a model. For nvcc only.
#pragma once

#include <utility>

#include "core/device/parallel.h"
#include "core/device/warp_reduce_cuda.h"
#include "render/tiles/tiles.h"

namespace tvsgs {
namespace tiles_detail {

inline constexpr int kThreads = 256;
inline constexpr std::uint32_t kLaneTiles =
    6;  // for more tiles than this, the lanes of the warp share the splat
inline constexpr unsigned kAll = 0xffffffffu;

/// Projected splats for the kernels.
template <class Shape>
struct Projected {
    TileGrid grid;
    Span<const Shape> shapes;
    Span<const TileRect> rects;
};

/// Number of tiles that a splat meets, and a bit per candidate if there are at most 32.
struct TileHits {
    std::uint32_t count = 0, mask = 0;
};

/// Calls found(splat, position, tile) for the tiles that each lane's splat meets; positions count
/// row by row from `first`. Returns the lane's hits. test_of(splat, candidates) returns the test of
/// a splat's tiles. Whole warps must call it; has_splat = false: the lane has no splat.
template <class Shape, class TestOf, class Found>
__device__ TileHits walk_tiles(const Projected<Shape>& in,
                               bool has_splat,
                               std::uint32_t splat,
                               std::uint32_t first,
                               const TestOf& test_of,
                               const Found& found) {
    const unsigned lane = threadIdx.x % 32;
    const TileRect rect = has_splat ? in.rects[splat] : TileRect{};
    const std::uint32_t candidates = rect.count();
    TileHits hits;
    if (candidates > 0 && candidates <= kLaneTiles) {
        const auto meets = test_of(splat, candidates);
        for (std::uint32_t at = 0; at < candidates; ++at) {
            const TileRect tile = rect_tile(rect, at);
            if (!meets(at, tile)) continue;
            found(splat, first + hits.count++, tile_index(in.grid, tile));
            hits.mask |= 1u << at;
        }
    }
    for (unsigned large = __ballot_sync(kAll, candidates > kLaneTiles); large != 0;
         large &= large - 1) {
        const int source = __ffs(int(large)) - 1;
        const std::uint32_t shared_splat = __shfl_sync(kAll, splat, source);
        const std::uint32_t shared_first = __shfl_sync(kAll, first, source);
        const TileRect shared_rect = in.rects[shared_splat];
        const std::uint32_t total = shared_rect.count();
        const auto meets = test_of(shared_splat, total);
        TileHits shared;
        for (std::uint32_t base = 0; base < total; base += 32) {
            const std::uint32_t at = base + lane;
            const TileRect tile = rect_tile(shared_rect, at < total ? at : 0);
            const bool hit = at < total && meets(at, tile);
            const unsigned mask = __ballot_sync(kAll, hit);
            if (hit)
                found(shared_splat, shared_first + shared.count + __popc(mask & ((1u << lane) - 1)),
                      tile_index(in.grid, tile));
            shared.count += __popc(mask);
            shared.mask = mask;
        }
        if (lane == static_cast<unsigned>(source)) hits = shared;
    }
    return hits;
}

/// Tests tiles with the splat's shape.
template <class Shape>
struct ShapeTest {
    TileGrid grid;
    Shape shape;
    __device__ bool operator()(std::uint32_t, TileRect tile) const {
        return meets_tiles(shape, grid, tile);
    }
};

/// Tests tiles with the bits kept from counting, or with the shape if there are none.
template <class Shape>
struct KeptTest {
    bool kept;
    std::uint32_t mask;
    ShapeTest<Shape> else_by;
    __device__ bool operator()(std::uint32_t at, TileRect tile) const {
        return kept ? mask >> at & 1 : else_by(at, tile);
    }
};

/// Counts the tiles of each splat. Adds all counts to totals[1] (integers, so any order gives the
/// same sum) and writes *in_view to totals[2].
template <class Shape>
__global__ void __launch_bounds__(kThreads)
    count_fragments_kernel(Projected<Shape> in,
                           Span<std::uint32_t> fragment_counts,
                           Span<std::uint32_t> hit_masks,
                           const std::uint32_t* in_view,
                           unsigned long long* totals) {
    __shared__ std::uint32_t block_total;
    if (threadIdx.x == 0) block_total = 0;
    __syncthreads();
    const std::uint32_t i = blockIdx.x * kThreads + threadIdx.x;
    const bool has_splat = i < fragment_counts.count;
    const TileHits hits = walk_tiles(
        in, has_splat, i, 0,
        [&](std::uint32_t splat, std::uint32_t) {
            return ShapeTest<Shape>{in.grid, in.shapes[splat]};
        },
        [](std::uint32_t, std::uint32_t, std::uint32_t) {});
    if (has_splat) fragment_counts[i] = hits.count;
    if (hits.count > 0) hit_masks[i] = hits.mask;
    const unsigned of_warp = warp_sum(hits.count);
    if (threadIdx.x % 32 == 0 && of_warp > 0) atomicAdd(&block_total, of_warp);
    __syncthreads();
    if (threadIdx.x == 0 && block_total > 0) atomicAdd(totals + 1, block_total);
    if (i == 0 && in_view != nullptr) totals[2] = *in_view;
}

/// Emits the fragments of the splats in order of depth. `first_of`: first fragment of each.
template <class Shape, class Key>
__global__ void __launch_bounds__(kThreads)
    emit_fragments_kernel(Projected<Shape> in,
                          Span<const std::uint32_t> hit_masks,
                          Span<const std::uint32_t> order,
                          Span<const std::uint32_t> first_of,
                          Span<std::uint32_t> first_fragment,
                          Key* tile_keys,
                          Span<std::uint32_t> fragments,
                          Span<std::uint32_t> splat_of_fragment) {
    const std::uint32_t k = blockIdx.x * kThreads + threadIdx.x;
    const bool has_splat = k < order.count;
    const std::uint32_t splat = has_splat ? order[k] : 0, first = has_splat ? first_of[k] : 0;
    if (has_splat) first_fragment[splat] = first;
    walk_tiles(
        in, has_splat, splat, first,
        [&](std::uint32_t of, std::uint32_t candidates) {
            KeptTest<Shape> test{candidates <= 32, hit_masks[of], {in.grid, {}}};
            if (!test.kept) test.else_by.shape = in.shapes[of];
            return test;
        },
        [&](std::uint32_t of, std::uint32_t fragment, std::uint32_t tile) {
            tile_keys[fragment] = static_cast<Key>(tile);
            fragments[fragment] = fragment;
            splat_of_fragment[fragment] = of;
        });
}

/// Computes, from the counts of fragments, lists.order (splats with fragments by depth, then index)
/// and first_fragment_by_depth, and resizes the arrays of fragments. The only host synchronisation
/// of a render.
void order_splats(Span<const float> depths, TileLists<Cuda>& lists);

/// True if tile_keys have 16 bits; else they have 32.
inline bool has_short_keys(const TileGrid& grid) {
    return grid.count() <= 1 << 16;
}

/// Sorts the emitted fragments by tile.
void sort_fragments(const TileGrid& grid, TileLists<Cuda>& lists);

/// Computes lists.longest_first from lists.spans.
void order_tiles(TileLists<Cuda>& lists);

template <class Key, class Shape>
void emit_fragments(const Projected<Shape>& in, TileLists<Cuda>& lists) {
    emit_fragments_kernel<<<(lists.visible_count + kThreads - 1) / kThreads, kThreads>>>(
        in, std::as_const(lists.hit_masks).span(), std::as_const(lists.order).span(),
        std::as_const(lists.first_fragment_by_depth).span(), lists.first_fragment.span(),
        reinterpret_cast<Key*>(lists.tile_keys.data()), lists.fragments_unsorted.span(),
        lists.splat_of_fragment.span());
    check_launch();
}

template <class Shape, class Features>
void list_fragments(const ViewSplats<Cuda, Shape, Features>& splats,
                    const TileGrid& grid,
                    TileLists<Cuda>& lists) {
    const int n = int(splats.rects.size());
    lists.fragment_counts.resize(n), lists.first_fragment.resize(n), lists.visible.resize(n);
    lists.spans.resize(grid.count()), lists.totals.resize(3), lists.hit_masks.resize(n);
    lists.spans.fill_zero(), lists.totals.fill_zero();
    lists.fragment_count = lists.visible_count = 0, lists.in_view = 0;
    lists.first_fragment_by_depth.resize(0);
    if (n == 0) return;
    const Projected<Shape> in{grid, splats.shapes.span(), splats.rects.span()};
    static_assert(sizeof(unsigned long long) == sizeof(std::uint64_t));
    count_fragments_kernel<<<(n + kThreads - 1) / kThreads, kThreads>>>(
        in, lists.fragment_counts.span(), lists.hit_masks.span(), splats.in_view,
        reinterpret_cast<unsigned long long*>(lists.totals.data()));
    check_launch();
    order_splats(splats.depths.span(), lists);
    if (lists.fragment_count == 0) return;
    if (has_short_keys(grid))
        emit_fragments<std::uint16_t>(in, lists);
    else
        emit_fragments<std::uint32_t>(in, lists);
    sort_fragments(grid, lists);
}

}  // namespace tiles_detail

template <class Shape, class Features>
void build_tile_lists(const ViewSplats<Cuda, Shape, Features>& splats,
                      const TileGrid& grid,
                      TileLists<Cuda>& lists) {
    tiles_detail::list_fragments(splats, grid, lists);
    tiles_detail::order_tiles(lists);
}

/// Instantiates the functions for one type of splat.
#define TVSGS_TILES_CUDA(Shape, Features)                                                     \
    template void build_tile_lists(const ViewSplats<Cuda, Shape, Features>&, const TileGrid&, \
                                   TileLists<Cuda>&);

}  // namespace tvsgs
