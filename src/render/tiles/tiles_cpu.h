// CPU version of the tile lists, for the .cpp file of a model.
#pragma once

#include <functional>
#include <vector>

#include "render/tiles/tiles.h"

namespace tvsgs {

/// Finds the tiles that a splat meets, one test after the other. A Shape with a test of several
/// tiles at once has a specialisation.
template <class Shape>
struct TileFinder {
    Span<const Shape> shapes;
    Span<const TileRect> rects;
    TileGrid grid;

    /// Writes the tiles of splats [begin, end) to `tiles`, splat by splat and row by row, and the
    /// number of each splat's tiles to `counts`.
    void operator()(std::size_t begin,
                    std::size_t end,
                    Span<std::uint32_t> counts,
                    std::vector<std::uint32_t>& tiles) const {
        for (std::size_t i = begin; i < end; ++i) {
            const std::size_t before = tiles.size();
            for (std::uint32_t at = 0; at < rects[i].count(); ++at) {
                const TileRect tile = rect_tile(rects[i], at);
                if (meets_tiles(shapes[i], grid, tile)) tiles.push_back(tile_index(grid, tile));
            }
            counts[i] = std::uint32_t(tiles.size() - before);
        }
    }
};

namespace detail {

/// Signature of TileFinder::operator().
using FindTiles = std::function<void(std::size_t begin,
                                     std::size_t end,
                                     Span<std::uint32_t> counts,
                                     std::vector<std::uint32_t>& tiles)>;

/// build_tile_lists() with a function that finds the tiles.
void list_tiles(Span<const float> depths,
                const TileGrid& grid,
                const FindTiles& find,
                TileLists<Cpu>& lists);

}  // namespace detail

template <class Shape, class Features>
void build_tile_lists(const ViewSplats<Cpu, Shape, Features>& splats,
                      const TileGrid& grid,
                      TileLists<Cpu>& lists) {
    detail::list_tiles(splats.depths.span(), grid,
                       TileFinder<Shape>{splats.shapes.span(), splats.rects.span(), grid}, lists);
}

/// Instantiates the functions for one type of splat.
#define TVSGS_TILES_CPU(Shape, Features)                                                     \
    template void build_tile_lists(const ViewSplats<Cpu, Shape, Features>&, const TileGrid&, \
                                   TileLists<Cpu>&);

}  // namespace tvsgs
