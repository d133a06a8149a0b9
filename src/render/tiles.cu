#include <cub/cub.cuh>

#include "core/parallel.h"
#include "render/tiles.h"

namespace tvsgs {
namespace {

/// First and last slot of each tile, read off the sorted keys.
struct TileSpansBody {
    Span<const std::uint64_t> keys;
    Span<TileSpan> spans;

    TVSGS_HD void operator()(int i) const {
        const std::uint64_t tile = keys[i] >> 32;
        const auto position = static_cast<std::uint32_t>(i);
        if (i == 0 || keys[i - 1] >> 32 != tile) spans[tile].begin = position;
        if (i + 1 == keys.size() || keys[i + 1] >> 32 != tile) spans[tile].end = position + 1;
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

}  // namespace

void build_tile_lists(const ViewSplats<Cuda>& splats,
                      const TileGrid& grid,
                      TileLists<Cuda>& lists) {
    const int n = static_cast<int>(splats.touched.size());
    lists.first_slot.resize(n);
    lists.spans.resize(grid.count());
    lists.spans.fill_zero();
    lists.slot_count = 0;
    if (n == 0) return;
    with_temporary(lists.temporary, [&](void* temp, std::size_t& bytes) {
        return cub::DeviceScan::ExclusiveSum(temp, bytes, splats.touched.data(),
                                             lists.first_slot.data(), n);
    });
    std::uint64_t last[2];  // the one host synchronisation of a render
    detail::copy(Cuda{}, lists.first_slot.data() + n - 1, Cpu{}, &last[0], sizeof last[0]);
    detail::copy(Cuda{}, splats.touched.data() + n - 1, Cpu{}, &last[1], sizeof last[1]);
    const std::uint64_t total = last[0] + last[1];
    check_slot_count(total);
    lists.slot_count = static_cast<int>(total);
    if (total == 0) return;
    lists.keys.resize(total), lists.keys_sorted.resize(total);
    lists.slots_unsorted.resize(total), lists.slots.resize(total),
        lists.splat_of_slot.resize(total);
    parallel_for(
        Cuda{}, n,
        EmitSlotsBody{grid, splats.shapes.span(), splats.depths.span(), splats.rects.span(),
                      splats.touched.span(), lists.first_slot.span(), lists.keys.span(),
                      lists.slots_unsorted.span(), lists.splat_of_slot.span()});
    int bits = 32;
    while ((1ll << (bits - 32)) < grid.count()) ++bits;
    with_temporary(lists.temporary, [&](void* temp, std::size_t& bytes) {
        return cub::DeviceRadixSort::SortPairs(
            temp, bytes, lists.keys.data(), lists.keys_sorted.data(), lists.slots_unsorted.data(),
            lists.slots.data(), lists.slot_count, 0, bits);
    });
    parallel_for(Cuda{}, lists.slot_count,
                 TileSpansBody{lists.keys_sorted.span(), lists.spans.span()});
}

}  // namespace tvsgs
