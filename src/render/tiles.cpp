#include "render/tiles.h"

#include <algorithm>
#include <vector>

#include "core/error.h"
#include "core/parallel.h"
#include "render/blend_pack.h"

namespace tvsgs {

void check_slot_count(std::uint64_t count) {
    if (count > kMaxSlots)
        throw Error(
            ExitCode::memory,
            str("rendering: ", count, " pairs of splat and tile in one view, at most ", kMaxSlots,
                " are possible; use smaller images (-r) or fewer splats (--max-gaussians)"));
}

namespace {

/// The tiles that splats [begin, end) meet, splat by splat and row by row, and how many each.
struct MeetTiles {
    Span<const SplatShape<float>> shapes;
    Span<const TileRect> rects;
    TileGrid grid;
    Span<std::uint32_t> counts;

    void narrow(std::size_t begin, std::size_t end, std::vector<std::uint32_t>& tiles) const {
        append<Pack<float>>(begin, end, tiles);
    }
    TVSGS_WIDE void wide(std::size_t begin,
                         std::size_t end,
                         std::vector<std::uint32_t>& tiles) const {
        append<Pack<float, kWideBytes>>(begin, end, tiles);
    }

private:
    template <class Lane>
    void append(std::size_t begin, std::size_t end, std::vector<std::uint32_t>& tiles) const {
        std::size_t count = 0;
        for (std::size_t i = begin; i < end; ++i) {
            const std::size_t before = count, most = before + rects[i].count();
            if (tiles.size() < most) tiles.resize(2 * most);
            if (most > before) count = append_splat<Lane>(shapes[i], rects[i], tiles.data(), count);
            counts[i] = static_cast<std::uint32_t>(count - before);
        }
        tiles.resize(count);
    }

    /// Tests a few tiles at a time, in two rows where they are short. Returns the new count.
    template <class Lane>
    std::size_t append_splat(const SplatShape<float>& shape,
                             TileRect rect,
                             std::uint32_t* tiles,
                             std::size_t count) const {
        const int columns = rect.x1 - rect.x0 <= 4 ? 4 : Lane::kSize, rows = Lane::kSize / columns;
        const auto s = broadcast<Lane>(shape);
        float lanes[2][Lane::kSize];
        for (int i = 0; i < Lane::kSize; ++i)
            lanes[0][i] = static_cast<float>(i % columns),
            lanes[1][i] = static_cast<float>(i / columns);
        const Lane lane_x = Lane::load(lanes[0]), lane_y = Lane::load(lanes[1]);
        constexpr float size = kTileSize;
        for (int y0 = rect.y0; y0 < rect.y1; y0 += rows)
            for (int x0 = rect.x0; x0 < rect.x1; x0 += columns) {
                const Lane x = static_cast<float>(x0) + lane_x, y = static_cast<float>(y0) + lane_y;
                // First and last pixel centres, clipped to the image.
                const Lane right = minimum((x + 1) * size, Lane(grid.width)),
                           bottom = minimum((y + 1) * size, Lane(grid.height));
                const auto meets =
                    may_draw(s, {x * size + 0.5f, y * size + 0.5f}, {right - 0.5f, bottom - 0.5f});
                const auto inside = both(x < Lane(rect.x1), y < Lane(rect.y1));
                for_bits(bits_of(both(meets, inside)), [&](int i) {
                    tiles[count++] = static_cast<std::uint32_t>((y0 + i / columns) * grid.columns +
                                                                x0 + i % columns);
                });
            }
        return count;
    }
};

/// Sorts splats by a 32-bit key, stably: three rounds of counting.
void sort_by_key(Buffer<std::uint32_t, Cpu>& keys,
                 Buffer<std::uint32_t, Cpu>& splats,
                 Buffer<std::uint32_t, Cpu>& other_keys,
                 Buffer<std::uint32_t, Cpu>& other_splats) {
    constexpr int kBits = 11;
    constexpr std::uint32_t kMask = (1u << kBits) - 1;
    other_keys.resize(keys.size()), other_splats.resize(keys.size());
    for (int shift = 0; shift < 32; shift += kBits) {
        std::uint32_t begin[kMask + 2] = {};
        for (const std::uint32_t key : keys.span()) ++begin[(key >> shift & kMask) + 1];
        for (std::uint32_t digit = 0; digit < kMask; ++digit) begin[digit + 1] += begin[digit];
        for (std::size_t i = 0; i < keys.size(); ++i) {
            const std::uint32_t to = begin[keys[i] >> shift & kMask]++;
            other_keys[to] = keys[i], other_splats[to] = splats[i];
        }
        keys.swap(other_keys), splats.swap(other_splats);
    }
}

}  // namespace

void build_tile_lists(const ViewSplats<Cpu>& splats, const TileGrid& grid, TileLists<Cpu>& lists) {
    const std::size_t n = splats.rects.size();
    lists.slot_counts.resize(n), lists.first_slot.resize(n);
    // Chunks of splats note what they meet, so that nothing is tested twice.
    constexpr std::size_t kChunk = 1024;
    const std::size_t chunks = (n + kChunk - 1) / kChunk;
    std::vector<std::vector<std::uint32_t>> met(chunks);
    const bool wide = has_wide_packs();
    const MeetTiles meet{splats.shapes.span(), splats.rects.span(), grid, lists.slot_counts.span()};
    parallel_for_heavy(Cpu{}, static_cast<int>(chunks), [&](int c) {
        auto& tiles = met[static_cast<std::size_t>(c)];
        const std::size_t begin = static_cast<std::size_t>(c) * kChunk,
                          end = std::min(n, begin + kChunk);
        wide ? meet.wide(begin, end, tiles) : meet.narrow(begin, end, tiles);
    });

    // Splats by depth, then index.
    std::size_t visible = 0;
    lists.order.resize(n), lists.depth_keys.resize(n);
    for (std::size_t i = 0; i < n; ++i)
        if (lists.slot_counts[i] > 0) {
            lists.order[visible] = static_cast<std::uint32_t>(i);
            lists.depth_keys[visible++] = depth_key(splats.depths[i]);
        }
    lists.visible_count = static_cast<int>(visible);
    lists.order.resize(visible), lists.depth_keys.resize(visible);
    sort_by_key(lists.depth_keys, lists.order, lists.depth_keys_sorted, lists.visible);

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
    parallel_for_heavy(Cpu{}, static_cast<int>(chunks), [&](int c) {
        const std::uint32_t* tiles = met[static_cast<std::size_t>(c)].data();
        const std::size_t begin = static_cast<std::size_t>(c) * kChunk;
        for (std::size_t i = begin; i < std::min(n, begin + kChunk); ++i) {
            const std::uint32_t count = lists.slot_counts[i];
            if (count == 0) continue;
            std::copy_n(tiles, count, lists.tile_keys.data() + lists.first_slot[i]);
            std::fill_n(lists.splat_of_slot.data() + lists.first_slot[i], count,
                        static_cast<std::uint32_t>(i));
            tiles += count;
        }
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
