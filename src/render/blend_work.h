// How much work blending a view is, counted: what is tested, evaluated in vain, and drawn.
#pragma once

#include "core/parallel.h"
#include "render/blend_ewa.h"

namespace tvsgs {

/// Walks the list of one warp of BlendWork as blending does; one index per warp.
struct CountBlendBody {
    static constexpr int kQuarter = kTileSize / 2, kPixels = kQuarter * kQuarter, kBatch = 32;

    Span<const SplatShape<float>> shapes;
    Span<const TileSpan> spans;
    Span<const std::uint32_t> splats;
    TileGrid grid;
    Span<BlendWork> work;

    TVSGS_HD void operator()(int warp) const {
        const int tile = warp / 4, left = tile % grid.columns * kTileSize + warp % 2 * kQuarter,
                  top = tile / grid.columns * kTileSize + warp % 4 / 2 * kQuarter;
        const int width = smaller(kQuarter, grid.width - left),
                  height = smaller(kQuarter, grid.height - top);
        BlendWork count;
        float T[kPixels];
        for (float& t : T) t = 1;
        bool full[kPixels];
        int open = 0;
        for (int k = 0; k < kPixels; ++k) {
            full[k] = k % kQuarter >= width || k / kQuarter >= height;
            open += full[k] ? 0 : 1;
        }
        const Vec2f low{static_cast<float>(left) + 0.5f, static_cast<float>(top) + 0.5f},
            high{static_cast<float>(left + width) - 0.5f, static_cast<float>(top + height) - 0.5f};
        const TileSpan span = spans[tile];
        for (std::uint32_t at = span.begin; at < span.end; ++at) {
            if ((at - span.begin) % kBatch == 0 && open == 0) break;
            const SplatShape<float>& s = shapes[splats[at]];
            ++count.tests;
            if (!may_draw(s, low, high)) continue;
            ++count.hits;
            std::uint32_t lanes = 0;
            for (int k = 0; k < kPixels; ++k) {
                if (full[k]) continue;
                ++count.evaluations;
                const Vec2f d{s.mean.x - (low.x + static_cast<float>(k % kQuarter)),
                              s.mean.y - (low.y + static_cast<float>(k / kQuarter))};
                PixelForward<float> pixel{T[k], {}};
                const float alpha = splat_alpha(s, d).alpha;
                if (alpha == 0) continue;
                if (!blend<Channels::color>(pixel, alpha, {})) {
                    full[k] = true, --open;
                    continue;
                }
                T[k] = pixel.T;
                ++count.contributions;
                lanes |= 1u << k % 32;
            }
            count.draws += lanes != 0;
            count.sums += (lanes & (lanes - 1)) != 0;
        }
        work[warp] = count;
    }

private:
    TVSGS_HD static int smaller(int a, int b) { return a < b ? a : b; }
};

template <class Device>
BlendWork count_blend_work(const EwaSplats<Device>& splats,
                           const TileLists<Device>& lists,
                           const TileGrid& grid) {
    Buffer<BlendWork, Device> warps(4 * static_cast<std::size_t>(grid.count()));
    parallel_for_heavy(Device{}, 4 * grid.count(),
                       CountBlendBody{splats.shapes.span(), lists.spans.span(), lists.splats.span(),
                                      grid, warps.span()});
    BlendWork sum;
    for (const BlendWork& w : to_host(warps)) {
        sum.tests += w.tests, sum.hits += w.hits, sum.evaluations += w.evaluations;
        sum.contributions += w.contributions, sum.draws += w.draws, sum.sums += w.sums;
    }
    return sum;
}

}  // namespace tvsgs
