// Blending model of the tests: round discs whose alpha falls to 0 at their edge, each with a
// sloping depth, six features besides colours, and records of other sizes than EWA's. A pixel
// measures the spread in depth of its discs; the derivative needs sums over all splats. Blended on
// either device.
#pragma once

#include <vector>

#include "core/scene/camera.h"
#include "render/tiles/blend.h"

namespace tvsgs::test {

inline constexpr int kExtras = 6;

struct alignas(16) Disc {
    Vec2f centre;  // px
    float radius, opacity;
};

TVSGS_HD inline bool may_draw(const Disc& disc, Vec2f low, Vec2f high) {
    const auto beyond = [](float value, float from, float to) {
        return value < from ? from - value : value > to ? value - to : 0.0f;
    };
    const float x = beyond(disc.centre.x, low.x, high.x), y = beyond(disc.centre.y, low.y, high.y);
    return x * x + y * y <= 1.0001f * disc.radius * disc.radius;
}

struct Extra {
    float of[kExtras];
};

struct alignas(16) DiscFeatures {
    Vec3f color;
    float depth;  // at the centre
    Vec2f slope;  // per px
    Extra extra;
};

struct alignas(16) DiscGradients {
    Vec2f centre, abs_centre;
    float radius, opacity;
    Vec3f color;
    float depth;
    Vec2f slope;
    Extra extra;
    float unused[2];

    static constexpr int kCount = 20;
};

/// Images of the model.
template <class Device>
struct DiscImages {
    Buffer<float, Device> transmittance, depth, moment, spread;
    Buffer<Vec3f, Device> color;
    Buffer<Extra, Device> extra;

    void resize(std::size_t pixels) {
        transmittance.resize(pixels), depth.resize(pixels), moment.resize(pixels);
        spread.resize(pixels), color.resize(pixels), extra.resize(pixels);
    }
};

struct DiscModel {
    using Shape = Disc;
    using Features = DiscFeatures;
    using Gradients = DiscGradients;
    static constexpr int kFilled = 18;
    TVSGS_HD static constexpr int filled(int v) { return v; }

    struct Hit {
        float alpha, inside;  // 1 at the centre, 0 at the edge
        Vec2f offset;
    };
    struct PixelForward {
        float T = 1;
        Vec3f color{};
        Extra extra{};
        float depth = 0, moment = 0;  // sums of weight z and of weight z^2
        float spread = 0;             // sum over pairs of w_i w_j (z_i - z_j)^2
    };
    struct PixelGradient {
        Vec3f color{};
        Extra extra{};
        float depth = 0, spread = 0;
        float all_weight = 0, all_depth = 0, all_moment = 0;  // sums over all splats
    };
    struct PixelBackward {
        float T;
        PixelGradient by;
        float behind = 0;
    };

    struct Writer {
        int width;
        Span<float> transmittance, depth, moment, spread;
        Span<Vec3f> color;
        Span<Extra> extra;

        TVSGS_HD void operator()(int x, int y, const PixelForward& pixel) const {
            const int at = y * width + x;
            transmittance[at] = pixel.T, depth[at] = pixel.depth, moment[at] = pixel.moment;
            spread[at] = pixel.spread, color[at] = pixel.color, extra[at] = pixel.extra;
        }
    };
    struct Reader {
        Span<const float> transmittance, depth, moment;
        Span<const PixelGradient> gradients;

        TVSGS_HD PixelGradient operator()(int at) const {
            PixelGradient g = gradients[at];
            g.all_weight = 1 - transmittance[at];
            g.all_depth = depth[at], g.all_moment = moment[at];
            return g;
        }
    };

    TVSGS_HD static Vec2f offset(const Disc& disc, Vec2f pixel) {
        return {pixel.x - disc.centre.x, pixel.y - disc.centre.y};
    }
    TVSGS_HD static Hit hit(const Disc& disc, Vec2f d) {
        const float inside = 1 - dot(d, d) / (disc.radius * disc.radius);
        if (!(inside > 0)) return {0, 0, {0, 0}};
        return {disc.opacity * inside * inside, inside, d};
    }
    TVSGS_HD static bool blend(PixelForward& pixel, const Hit& hit, const Features& f) {
        const float next = pixel.T * (1 - hit.alpha);
        if (next < 1e-4f) return false;
        const float w = hit.alpha * pixel.T, z = f.depth + dot(f.slope, hit.offset);
        pixel.spread += w * (z * z * (1 - pixel.T) + pixel.moment - 2 * z * pixel.depth);
        pixel.color += w * f.color;
        for (int k = 0; k < kExtras; ++k) pixel.extra.of[k] += w * f.extra.of[k];
        pixel.depth += w * z, pixel.moment += w * z * z;
        pixel.T = next;
        return true;
    }
    TVSGS_HD static void blend_vjp(
        PixelBackward& pixel, const Disc& disc, const Features& f, const Hit& hit, Gradients& g) {
        const PixelGradient& by = pixel.by;
        const float T = pixel.T / (1 - hit.alpha), w = hit.alpha * T;
        const float z = f.depth + dot(f.slope, hit.offset);
        float dL_dw = dot(by.color, f.color) + by.depth * z +
                      by.spread * (by.all_moment + z * z * by.all_weight - 2 * z * by.all_depth);
        for (int k = 0; k < kExtras; ++k) {
            dL_dw += by.extra.of[k] * f.extra.of[k];
            g.extra.of[k] += w * by.extra.of[k];
        }
        g.color += w * by.color;
        const float step = dL_dw - pixel.behind;
        pixel.behind += hit.alpha * step;
        pixel.T = T;
        const float dL_dz = w * (by.depth + 2 * by.spread * (z * by.all_weight - by.all_depth));
        g.depth += dL_dz;
        g.slope += dL_dz * hit.offset;

        const float dL_dalpha = T * step;
        g.opacity += dL_dalpha * hit.inside * hit.inside;
        const float dL_dinside = dL_dalpha * 2 * disc.opacity * hit.inside;
        const float r2 = disc.radius * disc.radius;
        g.radius += dL_dinside * 2 * dot(hit.offset, hit.offset) / (r2 * disc.radius);
        const Vec2f centre = (dL_dinside * 2 / r2) * hit.offset - dL_dz * f.slope;
        g.centre += centre;
        g.abs_centre += Vec2f{std::abs(centre.x), std::abs(centre.y)};
    }
    TVSGS_HD static void copy(const Features& from, Features& to) { to = from; }
};

struct DiscCase {
    int width, height;
    std::vector<Disc> discs;
    std::vector<DiscFeatures> features;
    std::vector<DiscModel::PixelGradient> dL_dpixels;
};

struct DiscResult {
    std::vector<float> transmittance, depth, spread;
    std::vector<Vec3f> color;
    std::vector<Extra> extra;
    std::vector<DiscGradients> gradients;  // per disc, zero if it did not draw
};

template <class Device>
DiscResult blend_discs(const DiscCase& in) {
    const TileGrid grid = tile_grid(in.width, in.height);
    SplatsOf<DiscModel, Device> splats;
    std::vector<float> depths;
    std::vector<TileRect> rects;
    for (std::size_t i = 0; i < in.discs.size(); ++i) {
        const Disc& disc = in.discs[i];
        depths.push_back(in.features[i].depth);
        rects.push_back(tile_rect(disc.centre, {disc.radius, disc.radius}, grid));
    }
    copy(in.discs, splats.shapes), copy(in.features, splats.features);
    copy(depths, splats.depths), copy(rects, splats.rects);
    TileLists<Device> lists;
    build_tile_lists(splats, grid, lists);

    const auto pixels = static_cast<std::size_t>(in.width) * static_cast<std::size_t>(in.height);
    DiscImages<Device> images;
    Buffer<std::uint32_t, Device> stops;
    images.resize(pixels), stops.resize(pixels);
    blend_tiles<DiscModel>(
        splats, lists, grid,
        {in.width, images.transmittance.span(), images.depth.span(), images.moment.span(),
         images.spread.span(), images.color.span(), images.extra.span()},
        stops);
    Buffer<DiscModel::PixelGradient, Device> dL_dpixels;
    copy(in.dL_dpixels, dL_dpixels);
    FragmentGradients<Device, DiscGradients> fragments;
    const DiscImages<Device>& blended = images;
    blend_tiles_vjp<DiscModel>(splats, lists, grid,
                               {blended.transmittance.span(), blended.depth.span(),
                                blended.moment.span(), std::as_const(dL_dpixels).span()},
                               images.transmittance, stops, fragments);

    DiscResult out{to_host(images.transmittance), to_host(images.depth), to_host(images.spread),
                   to_host(images.color),         to_host(images.extra), {}};
    const auto gradients = to_host(fragments.gradients);
    const auto drawn = to_host(fragments.drawn);
    const auto counts = to_host(lists.fragment_counts), first = to_host(lists.first_fragment);
    for (std::size_t i = 0; i < counts.size(); ++i) {
        const bool draws = counts[i] > 0 && drawn[first[i]];
        out.gradients.push_back(draws ? gradients[first[i]] : DiscGradients{});
        for (float& unused : out.gradients.back().unused) unused = 0;  // undefined
    }
    return out;
}

/// blend_discs<Cuda>, compiled by nvcc.
DiscResult blend_discs_cuda(const DiscCase& in);

}  // namespace tvsgs::test
