// Blending for a few neighbouring pixels at a time, as the CPU twin does it: where blend_math.h
// branches, here are both ways and a choice.
#pragma once

#include "render/view_splats.h"

namespace tvsgs {

/// Every entry the same.
template <class Lane>
SplatShape<Lane> broadcast(const SplatShape<float>& s) {
    return {{s.mean.x, s.mean.y}, {s.root.xx, s.root.xy, s.root.yy}, s.opacity, s.reach};
}
template <class Lane>
SplatFeatures<Lane> broadcast(const SplatFeatures<float>& f) {
    return {{f.color.x, f.color.y, f.color.z}, {f.normal.x, f.normal.y, f.normal.z}, f.distance};
}

/// Calls visit(k) for the bits that are set, from the lowest.
template <class Visit>
void for_bits(std::uint64_t bits, const Visit& visit) {
    for (; bits != 0; bits &= bits - 1) visit(std::countr_zero(bits));
}

/// What splat_alpha() needs of a splat that is the same all along a row of a tile, or down a part.
template <class Lane>
struct SplatInTile {
    static constexpr int kParts = kTileSize / Lane::kSize;
    std::uint64_t met;                                      // packs that it may draw in
    Lane along[kParts];                                     // xx dx, so that w.x = xy dy + xx dx
    alignas(Lane) float lean[kTileSize];                    // xy dy
    alignas(Lane) float down[kTileSize], down2[kTileSize];  // w.y and its square

    Vec2<Lane> whitened(int pack) const {
        const int row = pack % kTileSize;
        return {lean[row] + along[pack / kTileSize], down[row]};
    }
};

/// The pixels of a tile as packs of neighbours in a row; pack part * kTileSize + row.
template <class Lane>
struct TilePixels {
    static constexpr int kSize = Lane::kSize, kParts = kTileSize / kSize,
                         kCount = kParts * kTileSize;

    Lane x[kParts];                        // pixel centres
    Lane rows_y[kParts];                   // of kSize rows each
    Lane first_x[kParts], last_x[kParts];  // of each part, every entry the same

    TilePixels(int left_px, int top_px) {
        float columns[kTileSize], rows[kTileSize];
        for (int i = 0; i < kTileSize; ++i) {
            columns[i] = static_cast<float>(left_px + i) + 0.5f;
            rows[i] = static_cast<float>(top_px + i) + 0.5f;
        }
        for (int part = 0; part < kParts; ++part) {
            x[part] = Lane::load(columns + part * kSize);
            rows_y[part] = Lane::load(rows + part * kSize);
            first_x[part] = columns[part * kSize], last_x[part] = columns[(part + 1) * kSize - 1];
        }
    }

    /// A row of pixel centres crosses the ellipse where alpha is kMinAlpha or more between two
    /// points; rounding may only take them too far apart.
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
            // Above the ellipse and below it this is NaN, and no comparison holds.
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

/// A few splats of a tile, and the packs in which they may draw: their alphas are computed one
/// after the other, without a branch between them.
template <class Lane>
struct SplatBatch {
    using Pixels = TilePixels<Lane>;
    static constexpr std::uint32_t kSplats = 16;
    static constexpr int kAbreast = 4;
    static constexpr int kMost = kSplats * Pixels::kCount + kAbreast;

    struct Pair {
        std::uint16_t splat, pack;
    };
    SplatInTile<Lane> splats[kSplats + 1] = {};  // the last: of no splat
    float opacities[kSplats + 1] = {};
    Pair pairs[kMost];            // by splat; behind them some of no splat
    std::uint32_t ends[kSplats];  // of each splat's pairs
    Lane gauss[kMost];            // of the pairs; 0 where the splat does not draw

    void place(std::uint32_t j, const SplatShape<float>& shape, const Pixels& pixels) {
        pixels.place(shape, splats[j]);
        opacities[j] = shape.opacity;
    }

    /// For splats that are placed, in packs that are open. As splat_alpha() of blend_math.h.
    void compute(std::uint32_t splat_count, std::uint64_t open) {
        std::uint32_t count = 0;
        for (std::uint32_t j = 0; j < splat_count; ++j) {
            for_bits(splats[j].met & open, [&](int pack) {
                pairs[count++] = {static_cast<std::uint16_t>(j), static_cast<std::uint16_t>(pack)};
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

/// As in blend_math.h.
template <int kBytes>
void count_front(Pack<float, kBytes>& pixels, Pack<float, kBytes> T, Pack<float, kBytes> alpha) {
    using Lane = Pack<float, kBytes>;
    const auto front = both(T > Lane(kFrontTransmittance), alpha > Lane(0));
    pixels += select(front, Lane(1), Lane(0));
}

}  // namespace tvsgs
