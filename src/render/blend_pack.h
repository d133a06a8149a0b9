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

/// splat_alpha() of blend_math.h.
template <int kBytes>
SplatAlpha<Pack<float, kBytes>> splat_alpha(const SplatShape<Pack<float, kBytes>>& s,
                                            Vec2<Pack<float, kBytes>> d) {
    using Lane = Pack<float, kBytes>;
    const Vec2<Lane> w = whitened(s.root, d);
    const Lane gauss = FastMath::decay(multiply_add(w.x, w.x, w.y * w.y));
    const Lane alpha = s.opacity * gauss;
    const auto draws = alpha >= Lane(kMinAlpha);
    return {select(draws, gauss, Lane(0)),
            select(draws, select(alpha < Lane(kMaxAlpha), alpha, Lane(kMaxAlpha)), Lane(0))};
}

/// blend() of blend_math.h; an alpha of 0 changes nothing. Returns where the pixel was not full.
template <Channels kChannels, int kBytes>
auto blend(PixelForward<Pack<float, kBytes>>& pixel,
           Pack<float, kBytes> alpha,
           const SplatFeatures<Pack<float, kBytes>>& f) {
    using Lane = Pack<float, kBytes>;
    const Lane next = pixel.T * (1 - alpha);
    const auto fits = !(next < Lane(kMinTransmittance));
    add_features<kChannels>(pixel.sum, select(fits, alpha * pixel.T, Lane(0)), f);
    pixel.T = select(fits, next, pixel.T);
    return fits;
}

/// With an alpha of 0 blend_vjp() adds zeros everywhere but here.
template <int kBytes>
void count_front(Pack<float, kBytes>& pixels, Pack<float, kBytes> T, Pack<float, kBytes> alpha) {
    using Lane = Pack<float, kBytes>;
    const auto front = both(T > Lane(kFrontTransmittance), alpha > Lane(0));
    pixels += select(front, Lane(1), Lane(0));
}

/// The pixels of a tile as packs of neighbours in a row; pack part * kTileSize + row.
template <class Lane>
struct TilePixels {
    static constexpr int kSize = Lane::kSize, kParts = kTileSize / kSize,
                         kCount = kParts * kTileSize;

    Lane x[kParts];                        // pixel centres
    Lane rows_y[kParts];                   // of kSize rows each
    Lane y[kTileSize];                     // every entry the same
    Lane first_x[kParts], last_x[kParts];  // of each part, every entry the same

    TilePixels(int left_px, int top_px) {
        float columns[kTileSize], rows[kTileSize];
        for (int i = 0; i < kTileSize; ++i) {
            columns[i] = static_cast<float>(left_px + i) + 0.5f;
            rows[i] = static_cast<float>(top_px + i) + 0.5f;
            y[i] = rows[i];
        }
        for (int part = 0; part < kParts; ++part) {
            x[part] = Lane::load(columns + part * kSize);
            rows_y[part] = Lane::load(rows + part * kSize);
            first_x[part] = columns[part * kSize], last_x[part] = columns[(part + 1) * kSize - 1];
        }
    }

    /// From the pixel centres to a splat's mean.
    Vec2<Lane> offset(const SplatShape<Lane>& s, int pack) const {
        return {s.mean.x - x[pack / kTileSize], s.mean.y - y[pack % kTileSize]};
    }

    /// Bit k: the splat may draw in pack k. A row of pixel centres crosses the ellipse where
    /// alpha is kMinAlpha or more between two points; rounding may only take them too far apart.
    std::uint64_t packs_met(const SplatShape<float>& splat) const {
        const auto s = broadcast<Lane>(splat);
        const Lane inverse = 1 / s.root.xx, shear = s.root.xy * inverse;
        const Lane slack = 0.01f + 1e-5f * abs(s.mean.x), reach = s.reach + 1e-4f;
        std::uint64_t met = 0;
        for (int group = 0; group < kParts; ++group) {
            const Lane dy = s.mean.y - rows_y[group], across = s.root.yy * dy, lean = shear * dy;
            // Above the ellipse and below it this is NaN, and no comparison holds.
            const Lane half = sqrt(reach - across * across) * inverse;
            const Lane wide = half + (slack + 1e-5f * (half + abs(lean)));
            const Lane centre = s.mean.x + lean, low = centre - wide, high = centre + wide;
            for (int part = 0; part < kParts; ++part) {
                const std::uint64_t rows =
                    bits_of(both(low <= last_x[part], high >= first_x[part]));
                met |= rows << (part * kTileSize + group * kSize);
            }
        }
        return met;
    }
};

}  // namespace tvsgs
