// Lists of the splats that each tile draws, front to back.
#pragma once

#include <cstdint>

#include "core/device/buffer.h"
#include "core/math/vec.h"

namespace tvsgs {

inline constexpr int kTileSize = 16;  // px

struct TileGrid {
    int width, height, columns, rows;

    TVSGS_HD int count() const { return columns * rows; }
};

inline TileGrid tile_grid(int width, int height) {
    return {width, height, (width + kTileSize - 1) / kTileSize,
            (height + kTileSize - 1) / kTileSize};
}

/// Tiles [x0, x1) x [y0, y1).
struct alignas(8) TileRect {
    std::uint16_t x0, y0, x1, y1;

    TVSGS_HD std::uint32_t count() const { return std::uint32_t(x1 - x0) * std::uint32_t(y1 - y0); }
};

/// Tiles that meet the box centre +- extent, px; empty if the box is outside the image.
TVSGS_HD inline TileRect tile_rect(Vec2f centre, Vec2f extent, const TileGrid& grid) {
    const auto tile_range = [](float low, float high, int tiles, std::uint16_t& first,
                               std::uint16_t& last) {
        const float size = kTileSize, most = float(tiles);
        const auto clamped = [](float value, float lowest, float highest) {
            return value < lowest ? lowest : value > highest ? highest : value;
        };
        first = std::uint16_t(clamped(std::floor(low / size), 0.0f, most));
        last = std::uint16_t(clamped(std::floor(high / size) + 1, 0.0f, most));
    };
    TileRect rect;
    tile_range(centre.x - extent.x, centre.x + extent.x, grid.columns, rect.x0, rect.x1);
    tile_range(centre.y - extent.y, centre.y + extent.y, grid.rows, rect.y0, rect.y1);
    return rect;
}

/// The arrays of a ViewSplats.
template <class Shape, class Features>
struct ViewRecords {
    Span<Shape> shapes;
    Span<Features> features;
    Span<float> depths;
    Span<TileRect> rects;
};

/// Splats of a view, all [N]; N counts the splats with a place (splat_places.h). A splat with an
/// empty rectangle is not in view, and its other entries are undefined. may_draw(shape, low, high)
/// must return true if the Shape draws at any pixel centre in [low, high], px; a false positive
/// costs time but changes nothing.
template <class Device, class Shape, class Features>
struct ViewSplats {
    Buffer<Shape, Device> shapes;
    Buffer<Features, Device> features;
    Buffer<float, Device> depths;    // z in the camera frame
    Buffer<TileRect, Device> rects;  // tiles that it may meet
    /// Number of splats in view, on the device. It may exceed the number of places. Null: not
    /// needed.
    const std::uint32_t* in_view = nullptr;

    void resize(std::size_t n) {
        shapes.resize(n), features.resize(n), depths.resize(n), rects.resize(n);
    }
    ViewRecords<Shape, Features> records() {
        return {shapes.span(), features.span(), depths.span(), rects.span()};
    }
};

/// True if a splat may draw in these tiles; `tiles` is not empty.
template <class Shape>
TVSGS_HD bool meets_tiles(const Shape& shape, const TileGrid& grid, TileRect tiles) {
    const int right = tiles.x1 * kTileSize, bottom = tiles.y1 * kTileSize;
    // First and last pixel centres, clipped to the image.
    return may_draw(shape,
                    Vec2f{float(tiles.x0 * kTileSize) + 0.5f, float(tiles.y0 * kTileSize) + 0.5f},
                    Vec2f{float(right < grid.width ? right : grid.width) - 0.5f,
                          float(bottom < grid.height ? bottom : grid.height) - 0.5f});
}

/// Positions [begin, end) of a tile in TileLists::fragments.
struct TileSpan {
    std::uint32_t begin, end;
};

/// A fragment is one (splat, tile) pair. Fragments are numbered by depth of the splat, then index
/// of the splat, then tile. So a splat's fragments are contiguous, and a stable sort by tile leaves
/// each tile's fragments front to back.
template <class Device>
struct TileLists {
    Buffer<std::uint32_t, Device> fragment_counts;          // [N] 0: draws nothing
    Buffer<std::uint32_t, Device> first_fragment;           // [N] undefined if there are none
    Buffer<std::uint32_t, Device> first_fragment_by_depth;  // [visible] the same, front to back
    Buffer<std::uint32_t, Device> fragments;  // [fragments] by tile, then depth, then splat index
    Buffer<std::uint32_t, Device> splats;     // [fragments] splat of each
    Buffer<TileSpan, Device> spans;           // [tiles]
    Buffer<std::uint32_t, Device> longest_first;  // [tiles] tiles by length of span; CUDA only
    int fragment_count = 0, visible_count = 0;    // visible: splats with fragments
    std::uint32_t in_view = 0;                    // *ViewSplats::in_view; 0 if null

    // Scratch.
    Buffer<std::uint64_t, Device> totals;
    Buffer<std::uint32_t, Device> hit_masks;                                      // [N] CUDA only
    Buffer<std::uint32_t, Device> visible, order, depth_keys, depth_keys_sorted;  // [visible]
    Buffer<std::uint32_t, Device> splat_of_fragment, fragments_unsorted, tile_keys,
        tile_keys_sorted;
    Buffer<std::uint8_t, Device> temporary;
};

/// Finds a splat's tiles on a CPU; see tiles_cpu.h.
template <class Shape>
struct TileFinder;

/// Overwrites `lists`. Throws Error(ExitCode::memory) if there are 2^31 fragments or more. Compiled
/// per type of splat, see tiles_cpu.h and tiles_cuda.h.
template <class Shape, class Features>
void build_tile_lists(const ViewSplats<Cpu, Shape, Features>& splats,
                      const TileGrid& grid,
                      TileLists<Cpu>& lists);
template <class Shape, class Features>
void build_tile_lists(const ViewSplats<Cuda, Shape, Features>& splats,
                      const TileGrid& grid,
                      TileLists<Cuda>& lists);

/// Bits of a positive float, which order like the float.
TVSGS_HD inline std::uint32_t depth_key(float depth) {
    union {
        float value;
        std::uint32_t bits;
    } u{depth};
    return u.bits;
}

/// Tile number `at` of a rectangle, row by row.
TVSGS_HD inline TileRect rect_tile(TileRect rect, std::uint32_t at) {
    const std::uint32_t width = std::uint32_t(rect.x1 - rect.x0);
    const auto x = std::uint16_t(rect.x0 + at % width), y = std::uint16_t(rect.y0 + at / width);
    return {x, y, std::uint16_t(x + 1), std::uint16_t(y + 1)};
}
TVSGS_HD inline std::uint32_t tile_index(const TileGrid& grid, TileRect tile) {
    return std::uint32_t(tile.y0 * grid.columns + tile.x0);
}

inline constexpr std::uint64_t kMaxFragments = (1ull << 31) - 1;

/// Throws if the count is too large.
void check_fragment_count(std::uint64_t count);

}  // namespace tvsgs
