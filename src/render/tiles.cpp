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

namespace {

/// Counts the tiles that a splat meets and writes their indices from `tiles` on, unless it is null.
/// Not inlined: counting and writing must round alike.
[[gnu::noinline]] std::uint32_t tiles_met(const SplatShape<float>& shape,
                                          const TileGrid& grid,
                                          TileRect rect,
                                          std::uint32_t* tiles) {
    std::uint32_t count = 0;
    for (std::uint32_t at = 0; at < rect.count(); ++at) {
        const TileRect tile = rect_tile(rect, at);
        if (!ellipse_meets_tiles(shape, grid, tile)) continue;
        if (tiles != nullptr) tiles[count] = tile_index(grid, tile);
        ++count;
    }
    return count;
}

}  // namespace

void build_tile_lists(const ViewSplats<Cpu>& splats, const TileGrid& grid, TileLists<Cpu>& lists) {
    const std::size_t n = splats.rects.size();
    lists.slot_counts.resize(n), lists.first_slot.resize(n);
    parallel_for(Cpu{}, static_cast<int>(n), [&](int i) {
        const auto at = static_cast<std::size_t>(i);
        lists.slot_counts[at] = tiles_met(splats.shapes[at], grid, splats.rects[at], nullptr);
    });

    // Splats by depth, then index.
    std::size_t visible = 0;
    lists.order.resize(n);
    for (std::size_t i = 0; i < n; ++i)
        if (lists.slot_counts[i] > 0) lists.order[visible++] = static_cast<std::uint32_t>(i);
    lists.visible_count = static_cast<int>(visible);
    std::stable_sort(lists.order.data(), lists.order.data() + visible,
                     [&](std::uint32_t a, std::uint32_t b) {
                         return depth_key(splats.depths[a]) < depth_key(splats.depths[b]);
                     });

    std::uint64_t total = 0;
    lists.first_slot_by_depth.resize(visible);
    for (std::size_t k = 0; k < visible; ++k) {
        lists.first_slot_by_depth[k] = static_cast<std::uint32_t>(total);
        lists.first_slot[lists.order[k]] = static_cast<std::uint32_t>(total);
        total += lists.slot_counts[lists.order[k]];
    }
    check_slot_count(total);
    lists.slot_count = static_cast<int>(total);
    lists.tile_keys.resize(total), lists.splat_of_slot.resize(total);
    lists.slots.resize(total), lists.splats.resize(total);
    parallel_for(Cpu{}, static_cast<int>(visible), [&](int k) {
        const std::uint32_t splat = lists.order[static_cast<std::size_t>(k)];
        const std::uint32_t first = lists.first_slot[splat];
        const std::uint32_t count = tiles_met(splats.shapes[splat], grid, splats.rects[splat],
                                              lists.tile_keys.data() + first);
        std::fill_n(lists.splat_of_slot.data() + first, count, splat);
    });

    // A stable counting sort by tile.
    lists.spans.resize(static_cast<std::size_t>(grid.count()));
    lists.spans.fill_zero();
    for (std::uint32_t tile : lists.tile_keys.span()) ++lists.spans[tile].end;
    std::uint32_t begin = 0;
    for (TileSpan& span : lists.spans.span()) {
        const std::uint32_t count = span.end;
        span = {begin, begin};
        begin += count;
    }
    for (std::uint32_t slot = 0; slot < total; ++slot) {
        const std::uint32_t position = lists.spans[lists.tile_keys[slot]].end++;
        lists.slots[position] = slot;
        lists.splats[position] = lists.splat_of_slot[slot];
    }
}

}  // namespace tvsgs
