// Which splats each tile draws, front to back.
#pragma once

#include "render/view_splats.h"

namespace tvsgs {

/// Positions [begin, end) of a tile in TileLists::slots.
struct TileSpan {
    std::uint32_t begin, end;
};

/// A slot is one (splat, tile) pair. Slots are numbered by the depth of their splats, then the
/// splats' index, then tile: so a splat's slots are contiguous, and a stable sort by tile leaves
/// every tile's slots front to back.
template <class Device>
struct TileLists {
    Buffer<std::uint32_t, Device> slot_counts;          // [N] 0: draws nothing
    Buffer<std::uint32_t, Device> first_slot;           // [N] undefined where there are none
    Buffer<std::uint32_t, Device> first_slot_by_depth;  // [visible] the same, front to back
    Buffer<std::uint32_t, Device> slots;    // [slots] by tile, then depth, then splat index
    Buffer<std::uint32_t, Device> splats;   // [slots] of these slots
    Buffer<TileSpan, Device> spans;         // [tiles]
    int slot_count = 0, visible_count = 0;  // visible: splats with slots

    // Scratch.
    Buffer<std::uint64_t, Device> totals;
    Buffer<std::uint32_t, Device> hit_masks;                                      // [N] CUDA only
    Buffer<std::uint32_t, Device> visible, order, depth_keys, depth_keys_sorted;  // [visible]
    Buffer<std::uint32_t, Device> splat_of_slot, slots_unsorted, tile_keys, tile_keys_sorted;
    Buffer<std::uint8_t, Device> temporary;
};

/// Overwrites `lists`. Throws Error(ExitCode::memory) when there are 2^31 slots or more.
void build_tile_lists(const ViewSplats<Cpu>& splats, const TileGrid& grid, TileLists<Cpu>& lists);
void build_tile_lists(const ViewSplats<Cuda>& splats, const TileGrid& grid, TileLists<Cuda>& lists);

/// Positive floats order like their bits.
TVSGS_HD inline std::uint32_t depth_key(float depth) {
    union {
        float value;
        std::uint32_t bits;
    } u{depth};
    return u.bits;
}

/// Tile of a rectangle, counted row by row.
TVSGS_HD inline TileRect rect_tile(TileRect rect, std::uint32_t at) {
    const std::uint32_t width = static_cast<std::uint32_t>(rect.x1 - rect.x0);
    const auto x = static_cast<std::uint16_t>(rect.x0 + at % width),
               y = static_cast<std::uint16_t>(rect.y0 + at / width);
    return {x, y, static_cast<std::uint16_t>(x + 1), static_cast<std::uint16_t>(y + 1)};
}
TVSGS_HD inline std::uint32_t tile_index(const TileGrid& grid, TileRect tile) {
    return static_cast<std::uint32_t>(tile.y0 * grid.columns + tile.x0);
}

inline constexpr std::uint64_t kMaxSlots = (1ull << 31) - 1;

/// Throws when the count does not fit.
void check_slot_count(std::uint64_t count);

}  // namespace tvsgs
