#include <thrust/iterator/counting_iterator.h>
#include <thrust/iterator/transform_iterator.h>

#include <cub/cub.cuh>

#include "render/tiles/splat_places.h"
#include "render/tiles/tiles_cuda.h"

namespace tvsgs {
namespace {

struct DepthKeyBody {
    Span<const std::uint32_t> visible;
    Span<const float> depths;
    Span<std::uint32_t> keys;

    TVSGS_HD void operator()(int k) const { keys[k] = depth_key(depths[visible[k]]); }
};

struct FragmentsOf {
    Span<const std::uint32_t> fragment_counts;
    TVSGS_HD std::uint32_t operator()(std::uint32_t splat) const { return fragment_counts[splat]; }
};

/// Finds first and last position of each tile in the sorted keys, and the splats of the sorted
/// fragments.
template <class Key>
struct TileSpansBody {
    const Key* keys;
    Span<const std::uint32_t> fragments, splat_of_fragment;
    Span<std::uint32_t> splats;
    Span<TileSpan> spans;

    TVSGS_HD void operator()(int i) const {
        splats[i] = splat_of_fragment[fragments[i]];
        const Key tile = keys[i];
        const auto position = std::uint32_t(i);
        if (i == 0 || keys[i - 1] != tile) spans[tile].begin = position;
        if (i + 1 == fragments.size() || keys[i + 1] != tile) spans[tile].end = position + 1;
    }
};

/// Orders the tiles by length of their spans in steps of kStep, longest first, so that no long tile
/// starts last. Tiles of one step come in any order: no result depends on it. One block.
constexpr unsigned kOrderThreads = 1024, kStep = 8;
__global__ void __launch_bounds__(kOrderThreads)
    longest_first_kernel(Span<const TileSpan> spans, Span<std::uint32_t> order) {
    using Scan = cub::BlockScan<std::uint32_t, kOrderThreads>;
    __shared__ typename Scan::TempStorage scan;
    __shared__ std::uint32_t next[kOrderThreads];  // of each step, the longest first
    const auto step_of = [&](std::uint32_t tile) {
        const std::uint32_t length = (spans[tile].end - spans[tile].begin + kStep - 1) / kStep;
        return kOrderThreads - 1 - min(length, kOrderThreads - 1);
    };
    next[threadIdx.x] = 0;
    __syncthreads();
    for (std::uint32_t tile = threadIdx.x; tile < spans.count; tile += kOrderThreads)
        atomicAdd(&next[step_of(tile)], 1u);
    __syncthreads();
    std::uint32_t first;
    Scan(scan).ExclusiveSum(next[threadIdx.x], first);
    __syncthreads();
    next[threadIdx.x] = first;
    __syncthreads();
    for (std::uint32_t tile = threadIdx.x; tile < spans.count; tile += kOrderThreads)
        order[atomicAdd(&next[step_of(tile)], 1u)] = tile;
}

struct InView {
    Span<const float> radii;
    TVSGS_HD std::uint32_t operator()(std::uint32_t i) const {
        return i < radii.count && radii[i] > 0;
    }
};

/// Runs a CUB operation with temporary storage.
template <class Operation>
void with_temporary(Buffer<std::uint8_t, Cuda>& temporary, const Operation& operation) {
    std::size_t bytes = 0;
    check_cuda(operation(nullptr, bytes));
    if (temporary.size() < bytes) temporary.resize(bytes);
    check_cuda(operation(temporary.data(), bytes));
}

/// Sorts the splats with fragments by depth, then index.
void sort_by_depth(Span<const float> depths, TileLists<Cuda>& lists) {
    parallel_for(
        Cuda{}, lists.visible_count,
        DepthKeyBody{std::as_const(lists.visible).span(), depths, lists.depth_keys.span()});
    with_temporary(lists.temporary, [&](void* temp, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortPairs(temp, bytes, lists.depth_keys.data(),
                                               lists.depth_keys_sorted.data(), lists.visible.data(),
                                               lists.order.data(), lists.visible_count, 0,
                                               31);  // the sign is always 0
    });
}

template <class Key>
void sort_by_tile(const TileGrid& grid, TileLists<Cuda>& lists) {
    Key* const keys = reinterpret_cast<Key*>(lists.tile_keys.data());
    Key* const keys_sorted = reinterpret_cast<Key*>(lists.tile_keys_sorted.data());
    int bits = 1;
    while ((1ll << bits) < grid.count()) ++bits;
    with_temporary(lists.temporary, [&](void* temp, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortPairs(
            temp, bytes, keys, keys_sorted, lists.fragments_unsorted.data(), lists.fragments.data(),
            lists.fragment_count, 0, bits);
    });
    parallel_for(Cuda{}, lists.fragment_count,
                 TileSpansBody<Key>{keys_sorted, std::as_const(lists.fragments).span(),
                                    std::as_const(lists.splat_of_fragment).span(),
                                    lists.splats.span(), lists.spans.span()});
}

}  // namespace

void count_in_view(const Buffer<float, Cuda>& radii,
                   Buffer<std::uint32_t, Cuda>& before,
                   Buffer<std::uint8_t, Cuda>& temporary) {
    before.resize(radii.size() + 1);
    const auto in_view = thrust::make_transform_iterator(
        thrust::make_counting_iterator<std::uint32_t>(0), InView{radii.span()});
    with_temporary(temporary, [&](void* temp, std::size_t& bytes) {
        return cub::DeviceScan::ExclusiveSum(temp, bytes, in_view, before.data(),
                                             int(before.size()));
    });
}

void tiles_detail::order_splats(Span<const float> depths, TileLists<Cuda>& lists) {
    with_temporary(lists.temporary, [&](void* temp, std::size_t& bytes) {
        return cub::DeviceSelect::Flagged(
            temp, bytes, thrust::make_counting_iterator<std::uint32_t>(0),
            lists.fragment_counts.data(), lists.visible.data(), lists.totals.data(), depths.size());
    });
    const auto totals = to_host(lists.totals);
    const std::size_t visible = totals[0], total = totals[1];
    check_fragment_count(total);
    lists.visible_count = int(visible);
    lists.fragment_count = int(total);
    lists.in_view = std::uint32_t(totals[2]);
    lists.order.resize(visible), lists.first_fragment_by_depth.resize(visible);
    lists.depth_keys.resize(visible);
    lists.depth_keys_sorted.resize(visible);
    lists.fragments.resize(total), lists.splats.resize(total),
        lists.fragments_unsorted.resize(total);
    lists.splat_of_fragment.resize(total);
    lists.tile_keys.resize(total), lists.tile_keys_sorted.resize(total);
    if (total == 0) return;
    sort_by_depth(depths, lists);
    with_temporary(lists.temporary, [&](void* temp, std::size_t& bytes) {
        return cub::DeviceScan::ExclusiveSum(
            temp, bytes,
            thrust::make_transform_iterator(
                lists.order.data(), FragmentsOf{std::as_const(lists.fragment_counts).span()}),
            lists.first_fragment_by_depth.data(), lists.visible_count);
    });
}

void tiles_detail::sort_fragments(const TileGrid& grid, TileLists<Cuda>& lists) {
    if (has_short_keys(grid))
        sort_by_tile<std::uint16_t>(grid, lists);
    else
        sort_by_tile<std::uint32_t>(grid, lists);
}

void tiles_detail::order_tiles(TileLists<Cuda>& lists) {
    lists.longest_first.resize(lists.spans.size());
    longest_first_kernel<<<1, kOrderThreads>>>(std::as_const(lists.spans).span(),
                                               lists.longest_first.span());
    check_launch();
}

}  // namespace tvsgs
