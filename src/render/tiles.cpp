#include "render/tiles.h"

#include <algorithm>

#include "core/error.h"
#include "core/parallel.h"

namespace tvsgs {

void check_slot_count(std::uint64_t count) {
    if (count > kMaxSlots)
        throw Error(
            ExitCode::memory,
            str("rendering: ", count, " pairs of splat and tile in one view, at most ", kMaxSlots,
                " are possible; use smaller images (-r) or fewer splats (--max-gaussians)"));
}

void build_tile_lists(const ViewSplats<Cpu>& splats, const TileGrid& grid, TileLists<Cpu>& lists) {
    const int n = static_cast<int>(splats.touched.size());
    lists.first_slot.resize(static_cast<std::size_t>(n));
    std::uint64_t total = 0;
    for (int i = 0; i < n; ++i) {
        lists.first_slot[i] = total;
        total += splats.touched[i];
    }
    check_slot_count(total);
    lists.slot_count = static_cast<int>(total);
    lists.keys.resize(total), lists.slots_unsorted.resize(total);
    lists.splat_of_slot.resize(total), lists.slots.resize(total);
    parallel_for(
        Cpu{}, n,
        EmitSlotsBody{grid, splats.shapes.span(), splats.depths.span(), splats.rects.span(),
                      splats.touched.span(), lists.first_slot.span(), lists.keys.span(),
                      lists.slots_unsorted.span(), lists.splat_of_slot.span()});

    // Slots into their tiles, then each tile by (depth, slot).
    lists.spans.resize(static_cast<std::size_t>(grid.count()));
    lists.spans.fill_zero();
    for (std::uint64_t key : lists.keys.span()) ++lists.spans[key >> 32].end;
    std::uint32_t begin = 0;
    for (TileSpan& tile : lists.spans.span()) {
        const std::uint32_t count = tile.end;
        tile = {begin, begin};
        begin += count;
    }
    for (std::uint32_t slot = 0; slot < total; ++slot)
        lists.slots[lists.spans[lists.keys[slot] >> 32].end++] = slot;
    const Span<const std::uint64_t> keys = lists.keys.span();
    parallel_for_heavy(Cpu{}, grid.count(), [&](int tile) {
        const TileSpan span = lists.spans[static_cast<std::size_t>(tile)];
        std::sort(lists.slots.data() + span.begin, lists.slots.data() + span.end,
                  [&](std::uint32_t a, std::uint32_t b) {
                      return keys[a] != keys[b] ? keys[a] < keys[b] : a < b;
                  });
    });
}

}  // namespace tvsgs
