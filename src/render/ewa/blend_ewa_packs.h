// EWA blending on a CPU with packs of neighbouring pixels or tiles. Where blend_math.h branches,
// packs compute both sides and select. Results do not depend on the width of the packs.
#pragma once

#include <bit>

#include "render/ewa/blend_ewa.h"
#include "render/tiles/blend_cpu.h"
#include "render/tiles/tiles_cpu.h"

namespace tvsgs {

/// Copies the splat to every entry of a pack.
template <class Lane>
SplatShape<Lane> broadcast(const SplatShape<float>& s) {
    return {{s.mean.x, s.mean.y}, {s.root.xx, s.root.xy, s.root.yy}, s.opacity, s.reach};
}
template <class Lane>
SplatFeatures<Lane> broadcast(const SplatFeatures<float>& f) {
    return {{f.color.x, f.color.y, f.color.z}, {f.normal.x, f.normal.y, f.normal.z}, f.distance};
}

/// Calls visit(k) for each set bit k, from the lowest.
template <class Visit>
void for_bits(std::uint64_t bits, const Visit& visit) {
    for (; bits != 0; bits &= bits - 1) visit(std::countr_zero(bits));
}

/// Parts of splat_alpha() that are constant along a row of a tile, or down a column of packs.
template <class Lane>
struct SplatInTile {
    static constexpr int kParts = kTileSize / Lane::kSize;
    std::uint64_t met;                                      // packs in which it may draw
    Lane along[kParts];                                     // xx dx, so that w.x = xy dy + xx dx
    alignas(Lane) float lean[kTileSize];                    // xy dy
    alignas(Lane) float down[kTileSize], down2[kTileSize];  // w.y and its square

    Vec2<Lane> whitened(int pack) const {
        const int row = pack % kTileSize;
        return {lean[row] + along[pack / kTileSize], down[row]};
    }
};

/// The pixels of a tile as packs of neighbours in a row. The index of a pack is part * kTileSize +
/// row.
template <class Lane>
struct TilePixels {
    static constexpr int kSize = Lane::kSize, kParts = kTileSize / kSize,
                         kCount = kParts * kTileSize;

    Lane x[kParts];                        // pixel centres
    Lane rows_y[kParts];                   // of kSize rows each
    Lane first_x[kParts], last_x[kParts];  // of each part, in every entry

    TilePixels(int left_px, int top_px) {
        float columns[kTileSize], rows[kTileSize];
        for (int i = 0; i < kTileSize; ++i) {
            columns[i] = float(left_px + i) + 0.5f;
            rows[i] = float(top_px + i) + 0.5f;
        }
        for (int part = 0; part < kParts; ++part) {
            x[part] = Lane::load(columns + part * kSize);
            rows_y[part] = Lane::load(rows + part * kSize);
            first_x[part] = columns[part * kSize], last_x[part] = columns[(part + 1) * kSize - 1];
        }
    }

    /// Computes the packs in which a splat may draw. On a row of pixel centres, alpha is at least
    /// kMinAlpha between two points; rounding can only move these points outwards.
    void place(const SplatShape<float>& splat, SplatInTile<Lane>& out) const {
        const auto s = broadcast<Lane>(splat);
        const Lane inverse = 1 / s.root.xx;
        const Lane slack = 0.01f + 1e-5f * abs(s.mean.x), reach = s.reach + 1e-4f;
        out.met = 0;
        for (int part = 0; part < kParts; ++part)
            out.along[part] = s.root.xx * (s.mean.x - x[part]);
        for (int group = 0; group < kParts; ++group) {
            const Lane dy = s.mean.y - rows_y[group];
            const Lane down = s.root.yy * dy, lean = s.root.xy * dy, down2 = down * down;
            lean.store(&out.lean[group * kSize]);
            down.store(&out.down[group * kSize]), down2.store(&out.down2[group * kSize]);
            // NaN above and below the ellipse, where all comparisons are false.
            const Lane half = sqrt(reach - down2) * inverse, shift = lean * inverse;
            const Lane wide = half + (slack + 1e-5f * (half + abs(shift)));
            const Lane centre = s.mean.x + shift, low = centre - wide, high = centre + wide;
            for (int part = 0; part < kParts; ++part) {
                const std::uint64_t rows =
                    bits_of(both(low <= last_x[part], high >= first_x[part]));
                out.met |= rows << (part * kTileSize + group * kSize);
            }
        }
    }
};

/// Several splats of a tile and the packs in which they may draw. Their alphas are computed in one
/// loop without branches.
template <class Lane>
struct SplatBatch {
    using Pixels = TilePixels<Lane>;
    static constexpr std::uint32_t kSplats = 16;
    static constexpr int kAbreast = 4;
    static constexpr int kMost = kSplats * Pixels::kCount + kAbreast;

    struct Pair {
        std::uint16_t splat, pack;
    };
    SplatInTile<Lane> splats[kSplats + 1] = {};  // the last is an empty splat
    float opacities[kSplats + 1] = {};
    Pair pairs[kMost];            // by splat, then padding with the empty splat
    std::uint32_t ends[kSplats];  // end of each splat's pairs
    Lane gauss[kMost];            // of the pairs; 0 if the splat does not draw

    void place(std::uint32_t j, const SplatShape<float>& shape, const Pixels& pixels) {
        pixels.place(shape, splats[j]);
        opacities[j] = shape.opacity;
    }

    /// Computes `gauss` of the placed splats in the open packs, like splat_alpha() in blend_math.h.
    void compute(std::uint32_t splat_count, std::uint64_t open) {
        std::uint32_t count = 0;
        for (std::uint32_t j = 0; j < splat_count; ++j) {
            for_bits(splats[j].met & open, [&](int pack) {
                pairs[count++] = {std::uint16_t(j), std::uint16_t(pack)};
            });
            ends[j] = count;
        }
        using Few = Abreast<Lane, kAbreast>;
        for (std::uint32_t i = 0; i < kAbreast; ++i) pairs[count + i] = {kSplats, 0};
        for (std::uint32_t first = 0; first < count; first += kAbreast) {
            const Pair* const pair = pairs + first;
            const Few x =
                Few::each([&](int i) { return splats[pair[i].splat].whitened(pair[i].pack).x; });
            const Few y2 = Few::each(
                [&](int i) { return Lane(splats[pair[i].splat].down2[pair[i].pack % kTileSize]); });
            const Few g = FastMath::decay(x * x + y2);
            for (int i = 0; i < kAbreast; ++i) {
                const auto draws = opacities[pair[i].splat] * g.v[i] >= Lane(kMinAlpha);
                gauss[first + i] = select(draws, g.v[i], Lane(0));
            }
        }
    }
};

/// Like count_front() in blend_math.h.
template <int kBytes>
void count_front(Pack<float, kBytes>& pixels, Pack<float, kBytes> T, Pack<float, kBytes> alpha) {
    using Lane = Pack<float, kBytes>;
    const auto front = both(T > Lane(kFrontTransmittance), alpha > Lane(0));
    pixels += select(front, Lane(1), Lane(0));
}

template <>
struct TileFinder<SplatShape<float>> {
    Span<const SplatShape<float>> shapes;
    Span<const TileRect> rects;
    TileGrid grid;

    void operator()(std::size_t begin,
                    std::size_t end,
                    Span<std::uint32_t> counts,
                    std::vector<std::uint32_t>& tiles) const {
        has_wide_packs() ? wide(begin, end, counts, tiles)
                         : append<Pack<float>>(begin, end, counts, tiles);
    }

private:
    TVSGS_WIDE void wide(std::size_t begin,
                         std::size_t end,
                         Span<std::uint32_t> counts,
                         std::vector<std::uint32_t>& tiles) const {
        append<Pack<float, kWideBytes>>(begin, end, counts, tiles);
    }

    template <class Lane>
    void append(std::size_t begin,
                std::size_t end,
                Span<std::uint32_t> counts,
                std::vector<std::uint32_t>& tiles) const {
        std::size_t count = 0;
        for (std::size_t i = begin; i < end; ++i) {
            const std::size_t before = count, most = before + rects[i].count();
            if (tiles.size() < most) tiles.resize(2 * most);
            if (most > before) count = append_splat<Lane>(shapes[i], rects[i], tiles.data(), count);
            counts[i] = std::uint32_t(count - before);
        }
        tiles.resize(count);
    }

    /// Tests several tiles at once, in two rows if rows are short. Returns the new count.
    template <class Lane>
    std::size_t append_splat(const SplatShape<float>& shape,
                             TileRect rect,
                             std::uint32_t* tiles,
                             std::size_t count) const {
        const int columns = rect.x1 - rect.x0 <= 4 ? 4 : Lane::kSize, rows = Lane::kSize / columns;
        const auto s = broadcast<Lane>(shape);
        float lanes[2][Lane::kSize];
        for (int i = 0; i < Lane::kSize; ++i)
            lanes[0][i] = float(i % columns), lanes[1][i] = float(i / columns);
        const Lane lane_x = Lane::load(lanes[0]), lane_y = Lane::load(lanes[1]);
        constexpr float size = kTileSize;
        for (int y0 = rect.y0; y0 < rect.y1; y0 += rows)
            for (int x0 = rect.x0; x0 < rect.x1; x0 += columns) {
                const Lane x = float(x0) + lane_x, y = float(y0) + lane_y;
                // First and last pixel centres, clipped to the image.
                const Lane right = minimum((x + 1) * size, Lane(grid.width)),
                           bottom = minimum((y + 1) * size, Lane(grid.height));
                const auto meets =
                    may_draw(s, {x * size + 0.5f, y * size + 0.5f}, {right - 0.5f, bottom - 0.5f});
                const auto inside = both(x < Lane(rect.x1), y < Lane(rect.y1));
                for_bits(bits_of(both(meets, inside)), [&](int i) {
                    tiles[count++] =
                        std::uint32_t((y0 + i / columns) * grid.columns + x0 + i % columns);
                });
            }
        return count;
    }
};

namespace detail {

/// Calls visit(x, y, pack, entry) for the tile's pixels inside the image.
template <class Lane, class Visit>
void for_pixels(const TileBounds& t, const Visit& visit) {
    for (int y = t.top; y < t.bottom; ++y)
        for (int x = t.left; x < t.right; ++x)
            visit(x, y, (x - t.left) / Lane::kSize * kTileSize + y - t.top,
                  (x - t.left) % Lane::kSize);
}

inline std::uint64_t bit(int k, bool set) {
    return std::uint64_t(set) << k;
}

}  // namespace detail

template <Channels kChannels>
struct EwaForwardPacks : TilesForward<EwaModel<kChannels>> {
    using Tiles = TilesForward<EwaModel<kChannels>>;
    using Tiles::shapes, Tiles::features, Tiles::spans, Tiles::splats, Tiles::grid;
    using Tiles::write, Tiles::stop_out;

    void narrow(int tile) const { draw<Pack<float>>(tile); }
    TVSGS_WIDE void wide(int tile) const { draw<Pack<float, kWideBytes>>(tile); }

    template <class Lane>
    void draw(int tile) const {
        using detail::bit, detail::for_pixels;
        using Pixels = TilePixels<Lane>;
        const TileBounds t = tile_bounds(grid, tile);
        const Pixels tile_pixels(t.left, t.top);
        const TileSpan span = spans[tile];
        const std::uint32_t length = span.end - span.begin;
        PixelForward<Lane> pixels[Pixels::kCount];  // full pixels continue with T = 0
        Lane last_T[Pixels::kCount];                // of full pixels
        unsigned open_in[Pixels::kCount] = {};      // bits of the pixels that are not full
        std::uint64_t open = 0;                     // packs with open pixels
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

/// The values of a SplatGradients by column of pixels, in the order of the members.
struct LaneSums {
    static constexpr int kLanes = 8;  // columns with equal x modulo kLanes
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

    /// Sums over the lanes in a fixed order, four values at a time.
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

template <Channels kChannels, bool kParted>
struct EwaBackwardPacks : TilesBackward<EwaModel<kChannels, kParted>> {
    using Tiles = TilesBackward<EwaModel<kChannels, kParted>>;
    using Tiles::read, Tiles::transmittance, Tiles::stop_in, Tiles::gradients, Tiles::drawn;
    using Tiles::shapes, Tiles::features, Tiles::spans, Tiles::splats, Tiles::fragments,
        Tiles::grid;

    void narrow(int tile) const { draw<Pack<float>>(tile); }
    TVSGS_WIDE void wide(int tile) const { draw<Pack<float, kWideBytes>>(tile); }

    template <class Lane>
    void draw(int tile) const {
        using detail::bit, detail::for_pixels;
        using Pixels = TilePixels<Lane>;
        constexpr int kPasses =
            LaneSums::kLanes / Lane::kSize;  // each handles every kPasses-th part
        const TileBounds t = tile_bounds(grid, tile);
        const Pixels tile_pixels(t.left, t.top);
        PixelBackward<Lane> pixels[Pixels::kCount] = {};
        Lane stop[Pixels::kCount];
        std::uint32_t last_of[Pixels::kCount] = {}, last = 0;
        for_pixels<Lane>(t, [&](int x, int y, int k, int entry) {
            const std::size_t p = pixel_index(grid, x, y);
            set_entry(pixels[k], entry, transmittance[p], read(int(p)));
            pixels[k].behind.v[entry] = read.behind(int(p));
            stop[k].v[entry] = std::bit_cast<float>(stop_in[p]);
            last_of[k] = std::max(last_of[k], stop_in[p]), last = std::max(last, stop_in[p]);
        });
        SplatBatch<Lane> batch;
        const TileSpan span = spans[tile];
        for (std::uint32_t end = last; end > 0;) {
            const std::uint32_t count = std::min(batch.kSplats, end), begin = end - count;
            // From the last splat on.
            const std::uint32_t *const first = &splats[span.begin + end - 1],
                                       *const first_fragment = &fragments[span.begin + end - 1];
            for (std::uint32_t j = 0; j < count; ++j) {
                batch.place(j, shapes[*(first - j)], tile_pixels);
                __builtin_prefetch(&features[*(first - j)]);
                __builtin_prefetch(&gradients[*(first_fragment - j)], 1);
                __builtin_prefetch(&shapes[splats[span.begin + std::max(begin, j + 1) - 1 - j]]);
            }
            std::uint64_t open = 0;  // packs whose pixels these splats may draw
            for (int k = 0; k < Pixels::kCount; ++k) open |= bit(k, last_of[k] > begin);
            batch.compute(count, open);
            for (std::uint32_t i = 0, j = 0; j < count; ++j) {
                const std::uint32_t from = i;
                if (from == batch.ends[j]) continue;
                const auto shape = broadcast<Lane>(shapes[*(first - j)]);
                const auto f = broadcast<Lane>(features[*(first - j)].f);
                const Lane share(kParted ? features[*(first - j)].color_share : 1.0f);
                const Lane position = Lane::from_bits(std::int32_t(end - 1 - j));
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
                        blend_vjp<kChannels, kParted>(
                            pixels[k], shape.root, f, batch.splats[j].whitened(k),
                            {gauss, minimum(shape.opacity * gauss, Lane(kMaxAlpha))}, g, share);
                    }
                    sums.store(g, pass * Lane::kSize);
                }
                if (!any(draws)) continue;
                const std::uint32_t fragment = *(first_fragment - j);
                sums.add_up(gradients[fragment]);
                drawn[fragment] = 1;
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

}  // namespace tvsgs
