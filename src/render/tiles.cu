#include <thrust/iterator/counting_iterator.h>
#include <thrust/iterator/transform_iterator.h>

#include <cub/cub.cuh>

#include "core/parallel.h"
#include "render/tiles.h"

namespace tvsgs {
namespace {

constexpr int kThreads = 256;
constexpr std::uint32_t kLaneTiles = 6;  // above, a splat's tiles are shared among the warp's lanes
constexpr unsigned kAll = 0xffffffffu;

/// Projected splats as the kernels see them.
struct Projected {
    TileGrid grid;
    Span<const SplatShape<float>> shapes;
    Span<const TileRect> rects;
};

/// How many tiles a splat meets, and which: a bit per candidate where there are at most 32.
struct TileHits {
    std::uint32_t count = 0, mask = 0;
};

/// Calls found(splat, position, tile) for the tiles that each lane's splat meets, position counting
/// them row by row from `first` on; returns the lane's hits. test_of(splat, candidates) gives the
/// test of a splat's tiles. To be called by whole warps; has_splat false: no splat.
template <class TestOf, class Found>
__device__ TileHits walk_tiles(const Projected& in,
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
        const int source = __ffs(static_cast<int>(large)) - 1;
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

/// By the splat's ellipse.
struct EllipseTest {
    TileGrid grid;
    SplatShape<float> shape;
    __device__ bool operator()(std::uint32_t, TileRect tile) const {
        return ellipse_meets_tiles(shape, grid, tile);
    }
};

/// By what the ellipse said before, where that was kept.
struct KeptTest {
    bool kept;
    std::uint32_t mask;
    EllipseTest else_by;
    __device__ bool operator()(std::uint32_t at, TileRect tile) const {
        return kept ? mask >> at & 1 : else_by(at, tile);
    }
};

/// `total` gets the sum of all counts added: integers, so in any order.
__global__ void __launch_bounds__(kThreads) count_slots_kernel(Projected in,
                                                               Span<std::uint32_t> slot_counts,
                                                               Span<std::uint32_t> hit_masks,
                                                               unsigned long long* total) {
    __shared__ std::uint32_t block_total;
    if (threadIdx.x == 0) block_total = 0;
    __syncthreads();
    const std::uint32_t i = blockIdx.x * kThreads + threadIdx.x;
    const bool has_splat = i < slot_counts.count;
    const TileHits hits = walk_tiles(
        in, has_splat, i, 0,
        [&](std::uint32_t splat, std::uint32_t) {
            return EllipseTest{in.grid, in.shapes[splat]};
        },
        [](std::uint32_t, std::uint32_t, std::uint32_t) {});
    if (has_splat) slot_counts[i] = hits.count;
    if (hits.count > 0) hit_masks[i] = hits.mask;
    const unsigned of_warp = __reduce_add_sync(kAll, hits.count);
    if (threadIdx.x % 32 == 0 && of_warp > 0) atomicAdd(&block_total, of_warp);
    __syncthreads();
    if (threadIdx.x == 0 && block_total > 0) atomicAdd(total, block_total);
}

/// Slots of the splats in their order by depth; `first_of` holds the first one of each.
template <class Key>
__global__ void __launch_bounds__(kThreads) emit_slots_kernel(Projected in,
                                                              Span<const std::uint32_t> hit_masks,
                                                              Span<const std::uint32_t> order,
                                                              Span<const std::uint32_t> first_of,
                                                              Span<std::uint32_t> first_slot,
                                                              Key* tile_keys,
                                                              Span<std::uint32_t> slots,
                                                              Span<std::uint32_t> splat_of_slot) {
    const std::uint32_t k = blockIdx.x * kThreads + threadIdx.x;
    const bool has_splat = k < order.count;
    const std::uint32_t splat = has_splat ? order[k] : 0, first = has_splat ? first_of[k] : 0;
    if (has_splat) first_slot[splat] = first;
    walk_tiles(
        in, has_splat, splat, first,
        [&](std::uint32_t of, std::uint32_t candidates) {
            KeptTest test{candidates <= 32, hit_masks[of], {in.grid, {}}};
            if (!test.kept) test.else_by.shape = in.shapes[of];
            return test;
        },
        [&](std::uint32_t of, std::uint32_t slot, std::uint32_t tile) {
            tile_keys[slot] = static_cast<Key>(tile);
            slots[slot] = slot;
            splat_of_slot[slot] = of;
        });
}

struct DepthKeyBody {
    Span<const std::uint32_t> visible;
    Span<const float> depths;
    Span<std::uint32_t> keys;

    TVSGS_HD void operator()(int k) const { keys[k] = depth_key(depths[visible[k]]); }
};

struct SlotsOf {
    Span<const std::uint32_t> slot_counts;
    TVSGS_HD std::uint32_t operator()(std::uint32_t splat) const { return slot_counts[splat]; }
};

/// First and last position of each tile, read off the sorted keys; and the sorted slots' splats.
template <class Key>
struct TileSpansBody {
    const Key* keys;
    Span<const std::uint32_t> slots, splat_of_slot;
    Span<std::uint32_t> splats;
    Span<TileSpan> spans;

    TVSGS_HD void operator()(int i) const {
        splats[i] = splat_of_slot[slots[i]];
        const Key tile = keys[i];
        const auto position = static_cast<std::uint32_t>(i);
        if (i == 0 || keys[i - 1] != tile) spans[tile].begin = position;
        if (i + 1 == slots.size() || keys[i + 1] != tile) spans[tile].end = position + 1;
    }
};

/// Runs a CUB operation with the lists' temporary storage, grown outside of any kernel.
template <class Operation>
void with_temporary(Buffer<std::uint8_t, Cuda>& temporary, const Operation& operation) {
    std::size_t bytes = 0;
    check_cuda(operation(nullptr, bytes));
    if (temporary.size() < bytes) temporary.resize(bytes);
    check_cuda(operation(temporary.data(), bytes));
}

/// Splats with slots, by depth, then index.
void sort_by_depth(const ViewSplats<Cuda>& splats, TileLists<Cuda>& lists) {
    parallel_for(Cuda{}, lists.visible_count,
                 DepthKeyBody{std::as_const(lists.visible).span(), splats.depths.span(),
                              lists.depth_keys.span()});
    with_temporary(lists.temporary, [&](void* temp, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortPairs(temp, bytes, lists.depth_keys.data(),
                                               lists.depth_keys_sorted.data(), lists.visible.data(),
                                               lists.order.data(), lists.visible_count, 0,
                                               31);  // the sign is always 0
    });
}

/// Emits the slots in that order and sorts them by tile; `Key` holds a tile's index.
template <class Key>
void emit_and_sort(const Projected& in, const TileGrid& grid, TileLists<Cuda>& lists) {
    Buffer<std::uint32_t, Cuda>& first_of = lists.first_slot_by_depth;
    with_temporary(lists.temporary, [&](void* temp, std::size_t& bytes) {
        return cub::DeviceScan::ExclusiveSum(
            temp, bytes,
            thrust::make_transform_iterator(lists.order.data(),
                                            SlotsOf{std::as_const(lists.slot_counts).span()}),
            first_of.data(), lists.visible_count);
    });
    Key* const keys = reinterpret_cast<Key*>(lists.tile_keys.data());
    Key* const keys_sorted = reinterpret_cast<Key*>(lists.tile_keys_sorted.data());
    emit_slots_kernel<<<(lists.visible_count + kThreads - 1) / kThreads, kThreads>>>(
        in, std::as_const(lists.hit_masks).span(), std::as_const(lists.order).span(),
        std::as_const(first_of).span(), lists.first_slot.span(), keys, lists.slots_unsorted.span(),
        lists.splat_of_slot.span());
    check_launch();
    int bits = 1;
    while ((1ll << bits) < grid.count()) ++bits;
    with_temporary(lists.temporary, [&](void* temp, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortPairs(temp, bytes, keys, keys_sorted,
                                               lists.slots_unsorted.data(), lists.slots.data(),
                                               lists.slot_count, 0, bits);
    });
    parallel_for(Cuda{}, lists.slot_count,
                 TileSpansBody<Key>{keys_sorted, std::as_const(lists.slots).span(),
                                    std::as_const(lists.splat_of_slot).span(), lists.splats.span(),
                                    lists.spans.span()});
}

}  // namespace

void build_tile_lists(const ViewSplats<Cuda>& splats,
                      const TileGrid& grid,
                      TileLists<Cuda>& lists) {
    const int n = static_cast<int>(splats.rects.size());
    lists.slot_counts.resize(n), lists.first_slot.resize(n), lists.visible.resize(n);
    lists.spans.resize(grid.count()), lists.totals.resize(2), lists.hit_masks.resize(n);
    lists.spans.fill_zero(), lists.totals.fill_zero();
    lists.slot_count = lists.visible_count = 0;
    lists.first_slot_by_depth.resize(0);
    if (n == 0) return;
    const Projected in{grid, splats.shapes.span(), splats.rects.span()};
    static_assert(sizeof(unsigned long long) == sizeof(std::uint64_t));
    count_slots_kernel<<<(n + kThreads - 1) / kThreads, kThreads>>>(
        in, lists.slot_counts.span(), lists.hit_masks.span(),
        reinterpret_cast<unsigned long long*>(lists.totals.data() + 1));
    check_launch();
    with_temporary(lists.temporary, [&](void* temp, std::size_t& bytes) {
        return cub::DeviceSelect::Flagged(
            temp, bytes, thrust::make_counting_iterator<std::uint32_t>(0), lists.slot_counts.data(),
            lists.visible.data(), lists.totals.data(), n);
    });
    const auto totals = to_host(lists.totals);  // the one host synchronisation of a render
    const std::size_t visible = totals[0], total = totals[1];
    check_slot_count(total);
    lists.visible_count = static_cast<int>(visible);
    lists.slot_count = static_cast<int>(total);
    lists.order.resize(visible), lists.first_slot_by_depth.resize(visible);
    lists.depth_keys.resize(visible);
    lists.depth_keys_sorted.resize(visible);
    lists.slots.resize(total), lists.splats.resize(total), lists.slots_unsorted.resize(total);
    lists.splat_of_slot.resize(total);
    lists.tile_keys.resize(total), lists.tile_keys_sorted.resize(total);
    if (total == 0) return;
    sort_by_depth(splats, lists);
    if (grid.count() <= 1 << 16)
        emit_and_sort<std::uint16_t>(in, grid, lists);
    else
        emit_and_sort<std::uint32_t>(in, grid, lists);
}

}  // namespace tvsgs
