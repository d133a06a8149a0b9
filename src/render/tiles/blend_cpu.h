// CPU version of blending, for the .cpp file of a model: one task per tile, splat by splat over its
// pixels.
#pragma once

#include <algorithm>

#include "core/device/parallel.h"
#include "core/math/pack.h"
#include "render/tiles/blend.h"

namespace tvsgs {

struct TileBounds {
    int left, top, right, bottom;
};
inline TileBounds tile_bounds(const TileGrid& grid, int tile) {
    const int left = tile % grid.columns * kTileSize, top = tile / grid.columns * kTileSize;
    return {left, top, std::min(left + kTileSize, grid.width),
            std::min(top + kTileSize, grid.height)};
}

inline std::size_t pixel_index(const TileGrid& grid, int x, int y) {
    return std::size_t(y) * std::size_t(grid.width) + std::size_t(x);
}

/// Inputs and outputs of the tiles in a forward pass.
template <class Model>
struct TilesForward {
    Span<const typename Model::Shape> shapes;
    Span<const typename Model::Features> features;
    Span<const TileSpan> spans;
    Span<const std::uint32_t> splats;
    TileGrid grid;
    typename Model::Writer write;
    Span<std::uint32_t> stop_out;
};

/// Inputs and outputs of the tiles in a backward pass.
template <class Model>
struct TilesBackward {
    Span<const typename Model::Shape> shapes;
    Span<const typename Model::Features> features;
    Span<const TileSpan> spans;
    Span<const std::uint32_t> splats, fragments;
    TileGrid grid;
    typename Model::Reader read;
    Span<const float> transmittance;
    Span<const std::uint32_t> stop_in;
    Span<typename Model::Gradients> gradients;
    Span<std::uint8_t> drawn;
};

namespace detail {

inline Vec2f pixel_centre(int x, int y) {
    return {float(x) + 0.5f, float(y) + 0.5f};
}

/// The pixels of a tile in blocks, for models without packs. A splat is evaluated only in blocks in
/// which it may draw.
template <class State>
struct TileBlocks {
    static constexpr int kSide = 4, kPixels = kSide * kSide;

    struct Pixel {
        int x, y;
        State state;
    };
    struct Block {
        Vec2f low, high;  // pixel centres
        int count = 0;
        Pixel pixels[kPixels];
    };
    Block blocks[(kTileSize / kSide) * (kTileSize / kSide)];
    int count = 0;

    /// Calls start(state, x, y) for each pixel.
    template <class Start>
    TileBlocks(const TileBounds& t, const Start& start) {
        for (int top = t.top; top < t.bottom; top += kSide)
            for (int left = t.left; left < t.right; left += kSide) {
                Block& block = blocks[count++];
                const int right = std::min(left + kSide, t.right),
                          bottom = std::min(top + kSide, t.bottom);
                block.low = pixel_centre(left, top);
                block.high = pixel_centre(right - 1, bottom - 1);
                for (int y = top; y < bottom; ++y)
                    for (int x = left; x < right; ++x) {
                        Pixel& pixel = block.pixels[block.count++];
                        pixel.x = x, pixel.y = y;
                        start(pixel.state, x, y);
                    }
            }
    }

    template <class Shape, class Visit>
    void visit(const Shape& shape, const Visit& visit) {
        for (int b = 0; b < count; ++b) {
            Block& block = blocks[b];
            if (!may_draw(shape, block.low, block.high)) continue;
            for (int k = 0; k < block.count; ++k) visit(block.pixels[k]);
        }
    }
};

template <class Model>
void blend_tile(const TilesForward<Model>& in, int tile) {
    struct State {
        typename Model::PixelForward pixel{};
        std::uint32_t stop = 0;
        bool full = false;
    };
    TileBlocks<State> blocks(tile_bounds(in.grid, tile), [](State&, int, int) {});
    const TileSpan span = in.spans[tile];
    int open = kTileSize * kTileSize;
    for (std::uint32_t at = span.begin; at < span.end && open > 0; ++at) {
        const std::uint32_t splat = in.splats[at];
        const auto& shape = in.shapes[splat];
        blocks.visit(shape, [&](auto& p) {
            if (p.state.full) return;
            const auto hit = Model::hit(shape, Model::offset(shape, pixel_centre(p.x, p.y)));
            if (hit.alpha == 0) return;
            if (Model::blend(p.state.pixel, hit, in.features[splat]))
                p.state.stop = at - span.begin + 1;
            else
                p.state.full = true, --open;
        });
    }
    for (int b = 0; b < blocks.count; ++b)
        for (int k = 0; k < blocks.blocks[b].count; ++k) {
            const auto& p = blocks.blocks[b].pixels[k];
            in.write(p.x, p.y, p.state.pixel);
            in.stop_out[pixel_index(in.grid, p.x, p.y)] = p.state.stop;
        }
}

/// Visits the splats back to front.
template <class Model>
void blend_tile_vjp(const TilesBackward<Model>& in, int tile) {
    struct State {
        std::uint32_t stop;
        typename Model::PixelBackward pixel;
    };
    std::uint32_t last = 0;
    TileBlocks<State> blocks(tile_bounds(in.grid, tile), [&](State& state, int x, int y) {
        const std::size_t at = pixel_index(in.grid, x, y);
        state = {in.stop_in[at], pixel_backward<Model>(in.read, int(at), in.transmittance[at])};
        last = std::max(last, state.stop);
    });
    const std::uint32_t begin = in.spans[tile].begin;
    for (std::uint32_t position = last; position-- > 0;) {
        const std::uint32_t splat = in.splats[begin + position];
        const auto& shape = in.shapes[splat];
        typename Model::Gradients sum{};
        bool drawn = false;
        blocks.visit(shape, [&](auto& p) {
            if (position >= p.state.stop) return;
            const auto hit = Model::hit(shape, Model::offset(shape, pixel_centre(p.x, p.y)));
            if (hit.alpha == 0) return;
            Model::blend_vjp(p.state.pixel, shape, in.features[splat], hit, sum);
            drawn = true;
        });
        if (!drawn) continue;
        const std::uint32_t fragment = in.fragments[begin + position];
        in.gradients[fragment] = sum;
        in.drawn[fragment] = 1;
    }
}

/// Calls body.wide(tile) if the processor has wide packs and the caller wants them, else
/// body.narrow(tile).
template <class Body>
void for_tiles(const TileGrid& grid, PackWidth width, const Body& body) {
    const bool wide = width == PackWidth::widest && has_wide_packs();
    parallel_for_heavy(Cpu{}, grid.count(),
                       [&](int tile) { wide ? body.wide(tile) : body.narrow(tile); });
}

template <class Gradients>
void add_gradients(Gradients& sum, const Gradients& g) {
    auto* const to = reinterpret_cast<float*>(&sum);
    const auto* const from = reinterpret_cast<const float*>(&g);
    for (int v = 0; v < Gradients::kCount; ++v) to[v] += from[v];
}

}  // namespace detail

template <BlendModel Model>
void blend_tiles(const SplatsOf<Model, Cpu>& splats,
                 const TileLists<Cpu>& lists,
                 const TileGrid& grid,
                 const typename Model::Writer& write,
                 Buffer<std::uint32_t, Cpu>& stops,
                 PackWidth width) {
    const TilesForward<Model> in{splats.shapes.span(),
                                 splats.features.span(),
                                 lists.spans.span(),
                                 lists.splats.span(),
                                 grid,
                                 write,
                                 stops.span()};
    if constexpr (requires { typename Model::ForwardPacks; })
        detail::for_tiles(grid, width, typename Model::ForwardPacks{in});
    else
        parallel_for_heavy(Cpu{}, grid.count(), [&](int tile) { detail::blend_tile(in, tile); });
}

template <BlendModel Model>
void blend_tiles_vjp(const SplatsOf<Model, Cpu>& splats,
                     const TileLists<Cpu>& lists,
                     const TileGrid& grid,
                     const typename Model::Reader& read,
                     const Buffer<float, Cpu>& transmittance,
                     const Buffer<std::uint32_t, Cpu>& stops,
                     FragmentGradients<Cpu, typename Model::Gradients>& fragments,
                     PackWidth width) {
    fragments.resize(lists.fragment_count);
    fragments.drawn.fill_zero();
    const TilesBackward<Model> in{splats.shapes.span(),
                                  splats.features.span(),
                                  lists.spans.span(),
                                  lists.splats.span(),
                                  lists.fragments.span(),
                                  grid,
                                  read,
                                  transmittance.span(),
                                  stops.span(),
                                  fragments.gradients.span(),
                                  fragments.drawn.span()};
    if constexpr (requires { typename Model::BackwardPacks; })
        detail::for_tiles(grid, width, typename Model::BackwardPacks{in});
    else
        parallel_for_heavy(Cpu{}, grid.count(),
                           [&](int tile) { detail::blend_tile_vjp(in, tile); });
    // Sums the fragments of each splat in order.
    const auto& first_fragments = lists.first_fragment_by_depth;
    parallel_for(Cpu{}, lists.visible_count, [&](int k) {
        const auto rank = std::size_t(k);
        const std::size_t first = first_fragments[rank];
        const std::size_t end = rank + 1 < first_fragments.size()
                                    ? first_fragments[rank + 1]
                                    : std::size_t(lists.fragment_count);
        typename Model::Gradients sum{};
        bool drawn = false;
        for (std::size_t fragment = first; fragment < end; ++fragment)
            if (fragments.drawn[fragment])
                detail::add_gradients(sum, fragments.gradients[fragment]), drawn = true;
        fragments.gradients[first] = sum;
        fragments.drawn[first] = drawn;
    });
}

/// Instantiates the functions for a model, or only for its backward pass.
#define TVSGS_BLEND_CPU(Model)                                                           \
    template void blend_tiles<Model>(const SplatsOf<Model, Cpu>&, const TileLists<Cpu>&, \
                                     const TileGrid&, const typename Model::Writer&,     \
                                     Buffer<std::uint32_t, Cpu>&, PackWidth);            \
    TVSGS_BLEND_BACK_CPU(Model)
#define TVSGS_BLEND_BACK_CPU(Model)                                                            \
    template void blend_tiles_vjp<Model>(                                                      \
        const SplatsOf<Model, Cpu>&, const TileLists<Cpu>&, const TileGrid&,                   \
        const typename Model::Reader&, const Buffer<float, Cpu>&,                              \
        const Buffer<std::uint32_t, Cpu>&, FragmentGradients<Cpu, typename Model::Gradients>&, \
        PackWidth);

}  // namespace tvsgs
