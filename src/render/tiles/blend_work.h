// Counting the work of blending a view: tests, evaluations and contributions.
#pragma once

#include "core/device/parallel.h"
#include "render/backbone.h"
#include "render/tiles/blend.h"

namespace tvsgs {

/// Walks the list of one warp of BlendWork as blending does. One index per warp.
template <BlendModel Model>
struct CountBlendBody {
    static constexpr int kQuarter = kTileSize / 2, kPixels = kQuarter * kQuarter, kBatch = 32;

    Span<const typename Model::Shape> shapes;
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
        typename Model::PixelForward pixels[kPixels] = {};
        bool full[kPixels];
        int open = 0;
        for (int k = 0; k < kPixels; ++k) {
            full[k] = k % kQuarter >= width || k / kQuarter >= height;
            open += full[k] ? 0 : 1;
        }
        const Vec2f low{float(left) + 0.5f, float(top) + 0.5f},
            high{float(left + width) - 0.5f, float(top + height) - 0.5f};
        const TileSpan span = spans[tile];
        for (std::uint32_t at = span.begin; at < span.end; ++at) {
            if ((at - span.begin) % kBatch == 0 && open == 0) break;
            const typename Model::Shape& s = shapes[splats[at]];
            ++count.tests;
            if (!may_draw(s, low, high)) continue;
            ++count.hits;
            std::uint32_t lanes = 0;
            for (int k = 0; k < kPixels; ++k) {
                if (full[k]) continue;
                ++count.evaluations;
                const Vec2f centre{low.x + float(k % kQuarter), low.y + float(k / kQuarter)};
                const auto hit = Model::hit(s, Model::offset(s, centre));
                if (hit.alpha == 0) continue;
                if (!Model::blend(pixels[k], hit, {})) {
                    full[k] = true, --open;
                    continue;
                }
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

template <BlendModel Model, class Device>
BlendWork count_blend_work(const SplatsOf<Model, Device>& splats,
                           const TileLists<Device>& lists,
                           const TileGrid& grid) {
    Buffer<BlendWork, Device> warps(4 * std::size_t(grid.count()));
    parallel_for_heavy(Device{}, 4 * grid.count(),
                       CountBlendBody<Model>{splats.shapes.span(), lists.spans.span(),
                                             lists.splats.span(), grid, warps.span()});
    BlendWork sum;
    for (const BlendWork& w : to_host(warps)) {
        sum.tests += w.tests, sum.hits += w.hits, sum.evaluations += w.evaluations;
        sum.contributions += w.contributions, sum.draws += w.draws, sum.sums += w.sums;
    }
    return sum;
}

}  // namespace tvsgs
