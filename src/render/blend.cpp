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

/// Calls visit(x, y, pack, entry) for the tile's pixels in the image.
template <class Lane, class Visit>
void for_pixels(const TileBounds& t, const Visit& visit) {
    for (int y = t.top; y < t.bottom; ++y)
        for (int x = t.left; x < t.right; ++x)
            visit(x, y, (x - t.left) / Lane::kSize * kTileSize + y - t.top,
                  (x - t.left) % Lane::kSize);
}

/// Calls visit(k) for the bits that are set, from the lowest.
template <class Visit>
void for_bits(std::uint64_t bits, const Visit& visit) {
    for (; bits != 0; bits &= bits - 1) visit(std::countr_zero(bits));
}

/// Splats whose packs are looked up together, before any of them is drawn: short loops over what
/// does not depend on one another keep a processor busy.
constexpr std::uint32_t kBatch = 32;

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
        using Mask = typename Lane::Mask;
        const TileBounds t = tile_bounds(grid, tile);
        const Pixels tile_pixels(t.left, t.top);
        PixelForward<Lane> pixels[Pixels::kCount];
        Lane stop[Pixels::kCount];  // the bits of integers
        Mask full[Pixels::kCount];
        for (Mask& mask : full) mask = Lane(0) == Lane(0);
        std::uint64_t open = 0;
        for_pixels<Lane>(t, [&](int, int, int k, int entry) {
            full[k].bits[entry] = 0;
            open |= bit(k, true);
        });
        const TileSpan span = spans[static_cast<std::size_t>(tile)];
        std::uint64_t met_by[kBatch];
        Lane alphas[Pixels::kCount];
        for (std::uint32_t begin = span.begin; begin < span.end && open != 0; begin += kBatch) {
            const std::uint32_t count = std::min(kBatch, span.end - begin);
            for (std::uint32_t j = 0; j < count; ++j)
                met_by[j] = tile_pixels.packs_met(shapes[splats[begin + j]]);
            for (std::uint32_t j = 0; j < count; ++j) {
                const std::uint64_t met = met_by[j] & open;
                if (met == 0) continue;
                const std::uint32_t splat = splats[begin + j];
                const auto shape = broadcast<Lane>(shapes[splat]);
                for_bits(met, [&](int k) {
                    const Lane alpha = splat_alpha(shape, tile_pixels.offset(shape, k)).alpha;
                    alphas[k] = select(full[k], Lane(0), alpha);
                });
                const auto f = broadcast<Lane>(features[splat].f);
                const Lane position =
                    Lane::from_bits(static_cast<std::int32_t>(begin + j - span.begin + 1));
                for_bits(met, [&](int k) {
                    const Mask fits = blend<kChannels>(pixels[k], alphas[k], f);
                    stop[k] = select(both(alphas[k] > Lane(0), fits), position, stop[k]);
                    if (!any(!fits)) return;
                    full[k] = either(full[k], !fits);
                    if (!any(!full[k])) open &= ~bit(k, true);
                });
            }
        }
        for_pixels<Lane>(t, [&](int x, int y, int k, int entry) {
            write(x, y, pixel_of(pixels[k], entry));
            stop_out[static_cast<std::size_t>(y) * static_cast<std::size_t>(grid.width) +
                     static_cast<std::size_t>(x)] = std::bit_cast<std::uint32_t>(stop[k][entry]);
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
        constexpr int kPasses = kLanes / Lane::kSize;
        // Of the packs of a pass, every kPasses-th column of them.
        constexpr std::uint64_t kColumn = (std::uint64_t{1} << kTileSize) - 1;
        constexpr std::uint64_t kFirstPass = kColumn | kColumn << (kPasses * kTileSize);
        const TileBounds t = tile_bounds(grid, tile);
        const Pixels tile_pixels(t.left, t.top);
        PixelBackward<Lane> pixels[Pixels::kCount] = {};
        Lane stop[Pixels::kCount];
        std::uint32_t last_of[Pixels::kCount] = {}, last = 0;
        for_pixels<Lane>(t, [&](int x, int y, int k, int entry) {
            const int p = y * grid.width + x;
            set_entry(pixels[k], entry, transmittance[static_cast<std::size_t>(p)], read(p));
            const std::uint32_t s = stop_in[static_cast<std::size_t>(p)];
            stop[k].v[entry] = std::bit_cast<float>(s);
            last_of[k] = std::max(last_of[k], s), last = std::max(last, s);
        });
        // A pack takes part from its last contributor on.
        int by_last[Pixels::kCount];
        for (int k = 0; k < Pixels::kCount; ++k) by_last[k] = k;
        std::sort(by_last, by_last + Pixels::kCount,
                  [&](int a, int b) { return last_of[a] > last_of[b]; });
        int next = 0;
        std::uint64_t open = 0;
        std::uint64_t met_by[kBatch];
        SplatAlpha<Lane> alphas[Pixels::kCount];
        const TileSpan span = spans[static_cast<std::size_t>(tile)];
        for (std::uint32_t end = last; end > 0; end -= std::min(end, kBatch)) {
            const std::uint32_t begin = end - std::min(end, kBatch);
            for (std::uint32_t at = begin; at < end; ++at)
                met_by[at - begin] = tile_pixels.packs_met(shapes[splats[span.begin + at]]);
            for (std::uint32_t at = end; at-- > begin;) {
                for (; next < Pixels::kCount && last_of[by_last[next]] > at; ++next)
                    open |= bit(by_last[next], true);
                const std::uint64_t met = met_by[at - begin] & open;
                if (met == 0) continue;
                const std::uint32_t splat = splats[span.begin + at];
                const auto shape = broadcast<Lane>(shapes[splat]);
                const Lane position = Lane::from_bits(static_cast<std::int32_t>(at));
                typename Lane::Mask draws{};
                for_bits(met, [&](int k) {
                    const auto a = splat_alpha(shape, tile_pixels.offset(shape, k));
                    const auto reached = less_bits(position, stop[k]);
                    alphas[k] = {select(reached, a.gauss, Lane(0)),
                                 select(reached, a.alpha, Lane(0))};
                    draws = either(draws, alphas[k].alpha > Lane(0));
                });
                if (!any(draws)) continue;
                const auto f = broadcast<Lane>(features[splat].f);
                LaneSums sums;
                for (int pass = 0; pass < kPasses; ++pass) {
                    SplatGradients<Lane> g{};
                    for_bits(met & kFirstPass << (pass * kTileSize), [&](int k) {
                        blend_vjp<kChannels>(pixels[k], shape, f, tile_pixels.offset(shape, k),
                                             alphas[k], g);
                    });
                    sums.store(g, pass * Lane::kSize);
                }
                const std::uint32_t slot = slots[span.begin + at];
                sums.add_up(gradients[slot]);
                drawn[slot] = 1;
            }
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
    for_tiles(grid, width,
              BlendTile<kChannels>{splats.shapes.span(), splats.features.span(), lists.spans.span(),
                                   lists.splats.span(), grid,
                                   PixelWriter<kChannels>(images, camera), state.stop.span()});
}

template <Channels kChannels>
void blend_tiles_vjp(const ViewSplats<Cpu>& splats,
                     const TileLists<Cpu>& lists,
                     const TileGrid& grid,
                     const RenderedImages<Cpu>& images,
                     const BlendState<Cpu>& state,
                     const ImageGradients<Cpu>& dL_dimages,
                     SlotGradients<Cpu>& slots,
                     PackWidth width) {
    slots.resize(static_cast<std::size_t>(lists.slot_count));
    slots.drawn.fill_zero();
    for_tiles(grid, width,
              BlendTileVjp<kChannels>{
                  splats.shapes.span(),
                  splats.features.span(),
                  lists.spans.span(),
                  lists.splats.span(),
                  lists.slots.span(),
                  grid,
                  images.transmittance.span(),
                  state.stop.span(),
                  {dL_dimages.color.span(), dL_dimages.normal.span(), dL_dimages.distance.span()},
                  slots.gradients.span(),
                  slots.drawn.span()});
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
                                        BlendState<Cpu>&, PackWidth);                           \
    template void blend_tiles_vjp<channels>(const ViewSplats<Cpu>&, const TileLists<Cpu>&,      \
                                            const TileGrid&, const RenderedImages<Cpu>&,        \
                                            const BlendState<Cpu>&, const ImageGradients<Cpu>&, \
                                            SlotGradients<Cpu>&, PackWidth);
TVSGS_INSTANTIATE(Channels::color)
TVSGS_INSTANTIATE(Channels::color_plane)
TVSGS_INSTANTIATE(Channels::plane)

}  // namespace tvsgs
