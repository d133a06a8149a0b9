// CPU twin: one tile per task, splat by splat over the pixels of its box, so that a small splat
// costs a few pixels only.
#include "render/blend.h"

#include "core/parallel.h"

namespace tvsgs {
namespace {

constexpr int kPixels = kTileSize * kTileSize;

/// The part of a tile, in pixels, that a splat's box covers.
struct Box {
    int x0, y0, x1, y1;
};
Box box_in_tile(const SplatShape<float>& s, int left, int top, int right, int bottom) {
    // Pixel x is inside when |x + 0.5 - mean| <= extent.
    const auto first = [](float low, int least) {
        return std::max(least, static_cast<int>(std::ceil(std::max(low, -1e6f))));
    };
    const auto last = [](float high, int most) {
        return std::min(most, static_cast<int>(std::floor(std::min(high, 1e6f))) + 1);
    };
    const Vec2f extent = splat_extent(s);
    return {first(s.mean.x - extent.x - 0.5f, left), first(s.mean.y - extent.y - 0.5f, top),
            last(s.mean.x + extent.x - 0.5f, right), last(s.mean.y + extent.y - 0.5f, bottom)};
}

Vec2f offset(const SplatShape<float>& s, int x, int y) {
    return {s.mean.x - (static_cast<float>(x) + 0.5f), s.mean.y - (static_cast<float>(y) + 0.5f)};
}

struct TileBounds {
    int left, top, right, bottom;
};
TileBounds tile_bounds(const TileGrid& grid, int tile) {
    const int left = tile % grid.columns * kTileSize, top = tile / grid.columns * kTileSize;
    return {left, top, std::min(left + kTileSize, grid.width),
            std::min(top + kTileSize, grid.height)};
}

}  // namespace

template <Channels kChannels>
void blend_tiles(const ViewSplats<Cpu>& splats,
                 const TileLists<Cpu>& lists,
                 const TileGrid& grid,
                 const Camera& camera,
                 RenderedImages<Cpu>& images,
                 BlendState<Cpu>& state) {
    const PixelWriter<kChannels> write(images, camera);
    parallel_for_heavy(Cpu{}, grid.count(), [&](int tile) {
        const TileBounds t = tile_bounds(grid, tile);
        PixelForward<float> pixels[kPixels];
        std::uint32_t stop[kPixels] = {};
        bool full[kPixels] = {};
        int open = (t.right - t.left) * (t.bottom - t.top);
        const TileSpan span = lists.spans[static_cast<std::size_t>(tile)];
        for (std::uint32_t at = span.begin; at < span.end && open > 0; ++at) {
            const std::uint32_t splat = lists.splats[at];
            const SplatShape<float>& s = splats.shapes[splat];
            const SplatFeatures<float>& f = splats.features[splat].f;
            const Box box = box_in_tile(s, t.left, t.top, t.right, t.bottom);
            for (int y = box.y0; y < box.y1; ++y)
                for (int x = box.x0; x < box.x1; ++x) {
                    const int p = (y - t.top) * kTileSize + x - t.left;
                    if (full[p]) continue;
                    const float alpha = splat_alpha(s, offset(s, x, y)).alpha;
                    if (alpha == 0) continue;
                    if (blend<kChannels>(pixels[p], alpha, f)) {
                        stop[p] = at - span.begin + 1;
                    } else {
                        full[p] = true;
                        --open;
                    }
                }
        }
        for (int y = t.top; y < t.bottom; ++y)
            for (int x = t.left; x < t.right; ++x) {
                const int p = (y - t.top) * kTileSize + x - t.left;
                write(x, y, pixels[p]);
                state.stop[static_cast<std::size_t>(y) * grid.width + x] = stop[p];
            }
    });
}

template <Channels kChannels>
void blend_tiles_vjp(const ViewSplats<Cpu>& splats,
                     const TileLists<Cpu>& lists,
                     const TileGrid& grid,
                     const RenderedImages<Cpu>& images,
                     const BlendState<Cpu>& state,
                     const ImageGradients<Cpu>& dL_dimages,
                     SlotGradients<Cpu>& slots) {
    slots.resize(static_cast<std::size_t>(lists.slot_count));
    slots.drawn.fill_zero();
    const PixelGradientReader<kChannels> read{dL_dimages.color.span(), dL_dimages.normal.span(),
                                              dL_dimages.distance.span()};
    parallel_for_heavy(Cpu{}, grid.count(), [&](int tile) {
        const TileBounds t = tile_bounds(grid, tile);
        PixelBackward<float> pixels[kPixels];
        std::uint32_t stop[kPixels] = {}, last = 0;
        for (int y = t.top; y < t.bottom; ++y)
            for (int x = t.left; x < t.right; ++x) {
                const int p = (y - t.top) * kTileSize + x - t.left, at = y * grid.width + x;
                pixels[p] = {images.transmittance[static_cast<std::size_t>(at)], read(at), {}};
                stop[p] = state.stop[static_cast<std::size_t>(at)];
                last = std::max(last, stop[p]);
            }
        const TileSpan span = lists.spans[static_cast<std::size_t>(tile)];
        for (std::uint32_t at = last; at-- > 0;) {
            const std::uint32_t slot = lists.slots[span.begin + at];
            const std::uint32_t splat = lists.splats[span.begin + at];
            const SplatShape<float>& s = splats.shapes[splat];
            const SplatFeatures<float>& f = splats.features[splat].f;
            const Box box = box_in_tile(s, t.left, t.top, t.right, t.bottom);
            SplatGradients<float> g{};
            bool drawn = false;
            for (int y = box.y0; y < box.y1; ++y)
                for (int x = box.x0; x < box.x1; ++x) {
                    const int p = (y - t.top) * kTileSize + x - t.left;
                    if (at >= stop[p]) continue;
                    const Vec2f d = offset(s, x, y);
                    const SplatAlpha<float> a = splat_alpha(s, d);
                    if (a.alpha == 0) continue;
                    drawn = true;
                    blend_vjp<kChannels>(pixels[p], s, f, d, a, g);
                }
            slots.gradients[slot] = g;
            slots.drawn[slot] = drawn;
        }
    });
    // The slots of each splat, in their order.
    const auto& first_slots = lists.first_slot_by_depth;
    parallel_for(Cpu{}, lists.visible_count, [&](int k) {
        const auto rank = static_cast<std::size_t>(k);
        const std::size_t first = first_slots[rank];
        const std::size_t end = rank + 1 < first_slots.size()
                                    ? first_slots[rank + 1]
                                    : static_cast<std::size_t>(lists.slot_count);
        SplatGradients<float> sum{};
        bool drawn = false;
        for (std::size_t slot = first; slot < end; ++slot)
            if (slots.drawn[slot]) add(sum, slots.gradients[slot]), drawn = true;
        slots.gradients[first] = sum;
        slots.drawn[first] = drawn;
    });
}

#define TVSGS_INSTANTIATE(channels)                                                             \
    template void blend_tiles<channels>(const ViewSplats<Cpu>&, const TileLists<Cpu>&,          \
                                        const TileGrid&, const Camera&, RenderedImages<Cpu>&,   \
                                        BlendState<Cpu>&);                                      \
    template void blend_tiles_vjp<channels>(const ViewSplats<Cpu>&, const TileLists<Cpu>&,      \
                                            const TileGrid&, const RenderedImages<Cpu>&,        \
                                            const BlendState<Cpu>&, const ImageGradients<Cpu>&, \
                                            SlotGradients<Cpu>&);
TVSGS_INSTANTIATE(Channels::color)
TVSGS_INSTANTIATE(Channels::color_plane)
TVSGS_INSTANTIATE(Channels::plane)

}  // namespace tvsgs
