// CPU twin: one tile per task, splat by splat over its packs of pixels. Results do not depend on
// the packs' width.
#include "render/blend.h"

#include <bit>

#include "core/parallel.h"
#include "render/blend_pack.h"

namespace tvsgs {
namespace {

constexpr int kLanes = 8;  // sums over a splat's pixels: those of columns x = lane, modulo this

struct TileBounds {
    int left, top, right, bottom;
};
TileBounds tile_bounds(const TileGrid& grid, int tile) {
    const int left = tile % grid.columns * kTileSize, top = tile / grid.columns * kTileSize;
    return {left, top, std::min(left + kTileSize, grid.width),
            std::min(top + kTileSize, grid.height)};
}

std::size_t pixel_index(const TileGrid& grid, int x, int y) {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(grid.width) +
           static_cast<std::size_t>(x);
}

/// Calls visit(x, y, pack, entry) for the tile's pixels in the image.
template <class Lane, class Visit>
void for_pixels(const TileBounds& t, const Visit& visit) {
    for (int y = t.top; y < t.bottom; ++y)
        for (int x = t.left; x < t.right; ++x)
            visit(x, y, (x - t.left) / Lane::kSize * kTileSize + y - t.top,
                  (x - t.left) % Lane::kSize);
}

std::uint64_t bit(int k, bool set) {
    return static_cast<std::uint64_t>(set) << k;
}

template <Channels kChannels>
struct BlendTile {
    Span<const SplatShape<float>> shapes;
    Span<const FeatureRecord> features;
    Span<const TileSpan> spans;
    Span<const std::uint32_t> splats;
    TileGrid grid;
    PixelWriter<kChannels> write;
    Span<std::uint32_t> stop_out;

    void narrow(int tile) const { draw<Pack<float>>(tile); }
    TVSGS_WIDE void wide(int tile) const { draw<Pack<float, kWideBytes>>(tile); }

    template <class Lane>
    void draw(int tile) const {
        using Pixels = TilePixels<Lane>;
        const TileBounds t = tile_bounds(grid, tile);
        const Pixels tile_pixels(t.left, t.top);
        const TileSpan span = spans[static_cast<std::size_t>(tile)];
        const std::uint32_t length = span.end - span.begin;
        PixelForward<Lane> pixels[Pixels::kCount];  // a full pixel goes on with T = 0
        Lane last_T[Pixels::kCount];                // of full ones
        unsigned open_in[Pixels::kCount] = {};      // pixels of each pack that are not full
        std::uint64_t open = 0;                     // packs with such
        for_pixels<Lane>(t, [&](int x, int y, int k, int entry) {
            open_in[k] |= 1u << entry;
            open |= bit(k, true);
            stop_out[pixel_index(grid, x, y)] = length;
        });
        const auto close = [&](int k, unsigned entries, std::uint32_t position) {
            open_in[k] &= ~entries;
            if (open_in[k] == 0) open &= ~bit(k, true);
            for_bits(entries, [&](int entry) {
                last_T[k].v[entry] = pixels[k].T[entry], pixels[k].T.v[entry] = 0;
                const int x = t.left + k / kTileSize * Lane::kSize + entry;
                stop_out[pixel_index(grid, x, t.top + k % kTileSize)] = position;
            });
        };
        SplatBatch<Lane> batch;
        for (std::uint32_t begin = 0; begin < length && open != 0;) {
            const std::uint32_t count = std::min(batch.kSplats, length - begin);
            const std::uint32_t* const first = &splats[span.begin + begin];
            for (std::uint32_t j = 0; j < count; ++j) {
                batch.place(j, shapes[first[j]], tile_pixels);
                __builtin_prefetch(&features[first[j]]);
                __builtin_prefetch(
                    &shapes[splats[std::min(span.begin + begin + count + j, span.end - 1)]]);
            }
            batch.compute(count, open);
            for (std::uint32_t i = 0, j = 0; j < count; ++j) {
                const auto f = broadcast<Lane>(features[first[j]].f);
                const Lane opacity = batch.opacities[j];
                for (; i < batch.ends[j]; ++i) {
                    const int k = batch.pairs[i].pack;
                    PixelForward<Lane>& pixel = pixels[k];
                    const Lane alpha = minimum(opacity * batch.gauss[i], Lane(kMaxAlpha)),
                               rest = 1 - alpha;
                    const unsigned full =
                        bits_of(pixel.T * rest < Lane(kMinTransmittance)) & open_in[k];
                    if (full != 0) close(k, full, begin + j);
                    add_features<kChannels>(pixel.sum, alpha * pixel.T, f);
                    pixel.T = pixel.T * rest;
                }
            }
            begin += count;
        }
        for_pixels<Lane>(t, [&](int x, int y, int k, int entry) {
            auto pixel = pixel_of(pixels[k], entry);
            if ((open_in[k] >> entry & 1) == 0) pixel.T = last_T[k][entry];
            write(x, y, pixel);
        });
    }

    template <class Lane>
    static PixelForward<float> pixel_of(const PixelForward<Lane>& p, int i) {
        const SplatFeatures<Lane>& sum = p.sum;
        return {p.T[i],
                {{sum.color.x[i], sum.color.y[i], sum.color.z[i]},
                 {sum.normal.x[i], sum.normal.y[i], sum.normal.z[i]},
                 sum.distance[i]}};
    }
};

/// The values of a SplatGradients, each kept by column of pixels, in the order of the members.
struct LaneSums {
    static constexpr int kCount = SplatGradients<float>::kCount;
    alignas(32) float lanes[kCount][kLanes];

    template <class Lane>
    void store(const SplatGradients<Lane>& g, int first) {
        int v = 0;
        const auto put = [&](const auto&... values) { (values.store(&lanes[v++][first]), ...); };
        put(g.mean.x, g.mean.y, g.abs_mean.x, g.abs_mean.y);
        put(g.spread.xx, g.spread.xy, g.spread.yy, g.opacity);
        const SplatFeatures<Lane>& f = g.features;
        put(f.color.x, f.color.y, f.color.z, f.normal.x, f.normal.y, f.normal.z, f.distance);
        put(g.front_pixels);
    }

    /// Sums of the lanes, always in the same order; four values at a time.
    void add_up(SplatGradients<float>& out) const {
        using Four = Pack<float>;
        using Pick = Four::Ints;
        for (int v = 0; v < kCount; v += 4) {
            const auto halves = [&](int k) {
                return (Four::load(lanes[v + k]) + Four::load(lanes[v + k] + 4)).v;
            };
            const auto a = halves(0), b = halves(1), c = halves(2), d = halves(3);
            const Four ab = Four(__builtin_shuffle(a, b, Pick{0, 1, 4, 5})) +
                            Four(__builtin_shuffle(a, b, Pick{2, 3, 6, 7}));
            const Four cd = Four(__builtin_shuffle(c, d, Pick{0, 1, 4, 5})) +
                            Four(__builtin_shuffle(c, d, Pick{2, 3, 6, 7}));
            const Four sums = Four(__builtin_shuffle(ab.v, cd.v, Pick{0, 2, 4, 6})) +
                              Four(__builtin_shuffle(ab.v, cd.v, Pick{1, 3, 5, 7}));
            sums.store(reinterpret_cast<float*>(&out) + v);
        }
    }
};

template <Channels kChannels>
struct BlendTileVjp {
    Span<const SplatShape<float>> shapes;
    Span<const FeatureRecord> features;
    Span<const TileSpan> spans;
    Span<const std::uint32_t> splats, slots;
    TileGrid grid;
    Span<const float> transmittance;
    Span<const std::uint32_t> stop_in;
    PixelGradientReader<kChannels> read;
    Span<SplatGradients<float>> gradients;
    Span<std::uint8_t> drawn;

    void narrow(int tile) const { draw<Pack<float>>(tile); }
    TVSGS_WIDE void wide(int tile) const { draw<Pack<float, kWideBytes>>(tile); }

    template <class Lane>
    void draw(int tile) const {
        using Pixels = TilePixels<Lane>;
        constexpr int kPasses = kLanes / Lane::kSize;  // each through every kPasses-th part
        const TileBounds t = tile_bounds(grid, tile);
        const Pixels tile_pixels(t.left, t.top);
        PixelBackward<Lane> pixels[Pixels::kCount] = {};
        Lane stop[Pixels::kCount];
        std::uint32_t last_of[Pixels::kCount] = {}, last = 0;
        for_pixels<Lane>(t, [&](int x, int y, int k, int entry) {
            const std::size_t p = pixel_index(grid, x, y);
            set_entry(pixels[k], entry, transmittance[p], read(static_cast<int>(p)));
            stop[k].v[entry] = std::bit_cast<float>(stop_in[p]);
            last_of[k] = std::max(last_of[k], stop_in[p]), last = std::max(last, stop_in[p]);
        });
        SplatBatch<Lane> batch;
        const TileSpan span = spans[static_cast<std::size_t>(tile)];
        for (std::uint32_t end = last; end > 0;) {
            const std::uint32_t count = std::min(batch.kSplats, end), begin = end - count;
            // From the last one on.
            const std::uint32_t *const first = &splats[span.begin + end - 1],
                                       *const first_slot = &slots[span.begin + end - 1];
            for (std::uint32_t j = 0; j < count; ++j) {
                batch.place(j, shapes[*(first - j)], tile_pixels);
                __builtin_prefetch(&features[*(first - j)]);
                __builtin_prefetch(&gradients[*(first_slot - j)], 1);
                __builtin_prefetch(&shapes[splats[span.begin + std::max(begin, j + 1) - 1 - j]]);
            }
            std::uint64_t open = 0;  // packs with pixels that these may draw in
            for (int k = 0; k < Pixels::kCount; ++k) open |= bit(k, last_of[k] > begin);
            batch.compute(count, open);
            for (std::uint32_t i = 0, j = 0; j < count; ++j) {
                const std::uint32_t from = i;
                if (from == batch.ends[j]) continue;
                const auto shape = broadcast<Lane>(shapes[*(first - j)]);
                const auto f = broadcast<Lane>(features[*(first - j)].f);
                const Lane position = Lane::from_bits(static_cast<std::int32_t>(end - 1 - j));
                typename Lane::Mask draws{};
                LaneSums sums;
                for (int pass = 0; pass < kPasses; ++pass) {
                    SplatGradients<Lane> g{};
                    for (i = from; i < batch.ends[j]; ++i) {
                        const int k = batch.pairs[i].pack;
                        if (k / kTileSize % kPasses != pass) continue;
                        const Lane gauss =
                            select(less_bits(position, stop[k]), batch.gauss[i], Lane(0));
                        draws = either(draws, gauss > Lane(0));
                        blend_vjp<kChannels>(
                            pixels[k], shape.root, f, batch.splats[j].whitened(k),
                            {gauss, minimum(shape.opacity * gauss, Lane(kMaxAlpha))}, g);
                    }
                    sums.store(g, pass * Lane::kSize);
                }
                if (!any(draws)) continue;
                const std::uint32_t slot = *(first_slot - j);
                sums.add_up(gradients[slot]);
                drawn[slot] = 1;
            }
            end = begin;
        }
    }

    template <class Lane>
    static void set_entry(PixelBackward<Lane>& p,
                          int i,
                          float T,
                          const SplatFeatures<float>& dL_dpixel) {
        SplatFeatures<Lane>& g = p.dL_dpixel;
        p.T.v[i] = T;
        g.color.x.v[i] = dL_dpixel.color.x, g.color.y.v[i] = dL_dpixel.color.y;
        g.color.z.v[i] = dL_dpixel.color.z;
        g.normal.x.v[i] = dL_dpixel.normal.x, g.normal.y.v[i] = dL_dpixel.normal.y;
        g.normal.z.v[i] = dL_dpixel.normal.z, g.distance.v[i] = dL_dpixel.distance;
    }
};

/// body.wide(tile) where the processor has wide packs and the caller wants them.
template <class Body>
void for_tiles(const TileGrid& grid, PackWidth width, const Body& body) {
    const bool wide = width == PackWidth::widest && has_wide_packs();
    parallel_for_heavy(Cpu{}, grid.count(),
                       [&](int tile) { wide ? body.wide(tile) : body.narrow(tile); });
}

}  // namespace

template <Channels kChannels>
void blend_tiles(const ViewSplats<Cpu>& splats,
                 const TileLists<Cpu>& lists,
                 const TileGrid& grid,
                 const Camera& camera,
                 RenderedImages<Cpu>& images,
                 BlendState<Cpu>& state,
                 PackWidth width) {
    for_tiles(
        grid, width,
        BlendTile<kChannels>{splats.shapes.span(), splats.features.span(), lists.spans.span(),
                             lists.splats.span(), grid,
                             PixelWriter<kChannels>(images, state, camera), state.stop.span()});
}

template <Channels kChannels>
void blend_tiles_vjp(const ViewSplats<Cpu>& splats,
                     const TileLists<Cpu>& lists,
                     const TileGrid& grid,
                     const RenderedImages<Cpu>& images,
                     const BlendState<Cpu>& state,
                     const PixelGradientReader<kChannels>& dL_dpixel,
                     SlotGradients<Cpu>& slots,
                     PackWidth width) {
    slots.resize(static_cast<std::size_t>(lists.slot_count));
    slots.drawn.fill_zero();
    for_tiles(grid, width,
              BlendTileVjp<kChannels>{splats.shapes.span(), splats.features.span(),
                                      lists.spans.span(), lists.splats.span(), lists.slots.span(),
                                      grid, images.transmittance.span(), state.stop.span(),
                                      dL_dpixel, slots.gradients.span(), slots.drawn.span()});
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

#define TVSGS_INSTANTIATE(channels)                                                               \
    template void blend_tiles<channels>(const ViewSplats<Cpu>&, const TileLists<Cpu>&,            \
                                        const TileGrid&, const Camera&, RenderedImages<Cpu>&,     \
                                        BlendState<Cpu>&, PackWidth);                             \
    template void blend_tiles_vjp<channels>(                                                      \
        const ViewSplats<Cpu>&, const TileLists<Cpu>&, const TileGrid&,                           \
        const RenderedImages<Cpu>&, const BlendState<Cpu>&, const PixelGradientReader<channels>&, \
        SlotGradients<Cpu>&, PackWidth);
TVSGS_INSTANTIATE(Channels::color)
TVSGS_INSTANTIATE(Channels::color_plane)
TVSGS_INSTANTIATE(Channels::plane)

}  // namespace tvsgs
