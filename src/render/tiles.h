// Which splats each tile draws, front to back.
#pragma once

#include "render/view_splats.h"

namespace tvsgs {

/// Slots [begin, end) of a tile in TileLists::slots.
struct TileSpan {
    std::uint32_t begin, end;
};

/// A slot is one (splat, tile) pair, numbered in the order of the splats; a splat's slots are
/// contiguous.
template <class Device>
struct TileLists {
    Buffer<std::uint64_t, Device> first_slot;     // [N] first slot of each splat
    Buffer<std::uint32_t, Device> splat_of_slot;  // [slots]
    Buffer<std::uint32_t, Device> slots;          // [slots] by tile, then depth, then splat index
    Buffer<TileSpan, Device> spans;               // [tiles]
    int slot_count = 0;

    Buffer<std::uint64_t, Device> keys, keys_sorted;  // scratch
    Buffer<std::uint32_t, Device> slots_unsorted;
    Buffer<std::uint8_t, Device> temporary;
};

/// Overwrites `lists`. Throws Error(ExitCode::memory) when there are 2^31 slots or more.
void build_tile_lists(const ViewSplats<Cpu>& splats, const TileGrid& grid, TileLists<Cpu>& lists);
void build_tile_lists(const ViewSplats<Cuda>& splats, const TileGrid& grid, TileLists<Cuda>& lists);

/// Writes the slots of splat i with their sort keys (tile, bits of the depth): positive floats
/// order like integers.
struct EmitSlotsBody {
    TileGrid grid;
    Span<const SplatShape<float>> shapes;
    Span<const float> depths;
    Span<const TileRect> rects;
    Span<const std::uint64_t> touched, first_slot;
    Span<std::uint64_t> keys;
    Span<std::uint32_t> slots, splat_of_slot;

    TVSGS_HD void operator()(int i) const {
        if (touched[i] == 0) return;
        union {
            float value;
            std::uint32_t bits;
        } depth{depths[i]};
        std::uint64_t slot = first_slot[i];
        for (int ty = rects[i].y0; ty < rects[i].y1; ++ty)
            for (int tx = rects[i].x0; tx < rects[i].x1; ++tx) {
                if (!ellipse_meets_tile(shapes[i], grid, tx, ty)) continue;
                keys[slot] =
                    (static_cast<std::uint64_t>(ty * grid.columns + tx) << 32) | depth.bits;
                slots[slot] = static_cast<std::uint32_t>(slot);
                splat_of_slot[slot] = static_cast<std::uint32_t>(i);
                ++slot;
            }
    }
};

inline constexpr std::uint64_t kMaxSlots = (1ull << 31) - 1;

/// Throws when the count does not fit.
void check_slot_count(std::uint64_t count);

}  // namespace tvsgs
