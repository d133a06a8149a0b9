#include "render/tiles/tiles.h"

#include <algorithm>

#include "core/device/parallel.h"
#include "core/error.h"
#include "render/tiles/tiles_cpu.h"

namespace tvsgs {

void check_fragment_count(std::uint64_t count) {
    if (count > kMaxFragments)
        throw Error(ExitCode::memory, "rendering: ", count,
                    " pairs of splat and tile in one view, at most ", kMaxFragments,
                    " are possible; use smaller images (-r) or fewer splats (--max-gaussians)");
}

namespace {

/// Stable sort of splats by a 32-bit key: three rounds of counting sort.
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

void detail::list_tiles(Span<const float> depths,
                        const TileGrid& grid,
                        const FindTiles& find,
                        TileLists<Cpu>& lists) {
    const std::size_t n = depths.size();
    lists.fragment_counts.resize(n), lists.first_fragment.resize(n);
    // Each chunk of splats stores the tiles that it meets, so that nothing is tested twice.
    constexpr std::size_t kChunk = 1024;
    const std::size_t chunks = (n + kChunk - 1) / kChunk;
    std::vector<std::vector<std::uint32_t>> met(chunks);
    parallel_for_heavy(Cpu{}, int(chunks), [&](int c) {
        const std::size_t begin = std::size_t(c) * kChunk, end = std::min(n, begin + kChunk);
        find(begin, end, lists.fragment_counts.span(), met[c]);
    });

    // Sorts splats by depth, then index.
    std::size_t visible = 0;
    lists.order.resize(n), lists.depth_keys.resize(n);
    for (std::size_t i = 0; i < n; ++i)
        if (lists.fragment_counts[i] > 0) {
            lists.order[visible] = std::uint32_t(i);
            lists.depth_keys[visible++] = depth_key(depths[i]);
        }
    lists.visible_count = int(visible);
    lists.order.resize(visible), lists.depth_keys.resize(visible);
    sort_by_key(lists.depth_keys, lists.order, lists.depth_keys_sorted, lists.visible);

    std::uint64_t total = 0;
    lists.first_fragment_by_depth.resize(visible);
    for (std::size_t k = 0; k < visible; ++k) {
        lists.first_fragment_by_depth[k] = std::uint32_t(total);
        lists.first_fragment[lists.order[k]] = std::uint32_t(total);
        total += lists.fragment_counts[lists.order[k]];
    }
    check_fragment_count(total);
    lists.fragment_count = int(total);
    lists.tile_keys.resize(total), lists.splat_of_fragment.resize(total);
    lists.fragments.resize(total), lists.splats.resize(total);
    parallel_for_heavy(Cpu{}, int(chunks), [&](int c) {
        const std::uint32_t* tiles = met[c].data();
        const std::size_t begin = std::size_t(c) * kChunk;
        for (std::size_t i = begin; i < std::min(n, begin + kChunk); ++i) {
            const std::uint32_t count = lists.fragment_counts[i];
            if (count == 0) continue;
            std::copy_n(tiles, count, lists.tile_keys.data() + lists.first_fragment[i]);
            std::fill_n(lists.splat_of_fragment.data() + lists.first_fragment[i], count,
                        std::uint32_t(i));
            tiles += count;
        }
    });

    // Stable counting sort by tile.
    lists.spans.resize(grid.count());
    lists.spans.fill_zero();
    for (std::uint32_t tile : lists.tile_keys.span()) ++lists.spans[tile].end;
    std::uint32_t begin = 0;
    for (TileSpan& span : lists.spans.span()) {
        const std::uint32_t count = span.end;
        span = {begin, begin};
        begin += count;
    }
    for (std::uint32_t fragment = 0; fragment < total; ++fragment) {
        const std::uint32_t position = lists.spans[lists.tile_keys[fragment]].end++;
        lists.fragments[position] = fragment;
        lists.splats[position] = lists.splat_of_fragment[fragment];
    }
}

}  // namespace tvsgs
