// The opacity field for both devices; opacity_field.cpp and opacity_field.cu instantiate it.
#pragma once

#include <utility>

#include "core/error.h"
#include "core/progress.h"
#include "core/scene/scene.h"
#include "mesh/tetrahedra/opacity_field.h"

namespace tvsgs {
namespace detail {

template <class Device>
using FieldViewSplats = ViewSplats<Device, FieldShape, RayGaussian<float>>;

/// Prepares a splat for the tile lists of a view.
struct FieldSplatBody {
    Camera camera;
    TileGrid grid;
    float near;
    Span<const Vec3f> means, scales;
    Span<const Quatf> quats;
    Span<const float> opacities;
    Span<FieldShape> shapes;
    Span<RayGaussian<float>> gaussians;
    Span<float> depths;
    Span<TileRect> rects;

    TVSGS_HD void operator()(int i) const {
        rects[i] = {};
        const Vec3f p = camera.camera_from_world * means[i];
        const float opacity = opacities[i];
        if (!(p.z > near) || !is_finite(p) || !(opacity >= kMinAlpha)) return;
        const Mat3f axes = camera.camera_from_world.R * rotation(quats[i]);
        const Vec3f s = kept_scales(scales[i]);
        // Slightly beyond the cut-off of alpha.
        const float reach2 = 2 * splat_reach(opacity) + 0.001f;
        if (!is_finite(reach2 * (s * s))) return;
        const EllipsoidImage<float> image = ellipsoid_image(camera, axes, s, p, reach2);
        const float xx = 1.001f * image.shape.xx + 0.1f, yy = 1.001f * image.shape.yy + 0.1f;
        const float xy = image.shape.xy, det = xx * yy - xy * xy;
        FieldShape shape{image.mean, {1, 0, 1}, INFINITY, p.z - 1.001f * image.half_depth};
        TileRect rect{0, 0, static_cast<std::uint16_t>(grid.columns),
                      static_cast<std::uint16_t>(grid.rows)};
        if (image.bounded && det > 0 && det < 1e30f) {
            shape.root = ellipse_root(Sym2f{xx, xy, yy}, det), shape.reach = 0.5f;
            if (!is_finite(Vec3f{image.mean.x, image.mean.y, xx + yy})) return;
            rect = tile_rect(image.mean, {std::sqrt(xx), std::sqrt(yy)}, grid);
        }
        if (rect.count() == 0 || !meets_tiles(shape, grid, rect)) return;
        shapes[i] = shape;
        gaussians[i] = ray_gaussian(axes, s, p, opacity);
        depths[i] = p.z;
        rects[i] = rect;
    }
};

/// A view with the splats of its tiles.
struct FieldView {
    Camera camera;
    TileGrid grid;
    float near;
    Span<const std::uint8_t> mask;  // may be empty
    Span<const TileSpan> spans;
    Span<const std::uint32_t> splats;
    Span<const FieldShape> shapes;
    Span<const RayGaussian<float>> gaussians;

    /// Counts the view if its image contains the point. Goes front to back, which ends early for
    /// hidden points.
    TVSGS_HD void look(Vec3f point, Sight& sight) const {
        const Vec3f p = camera.camera_from_world * point;
        if (!(p.z > near) || !is_finite(p)) return;
        const Vec3f ray{p.x / p.z, p.y / p.z, 1};
        const float u = camera.fx_px * ray.x + camera.cx_px,
                    v = camera.fy_px * ray.y + camera.cy_px;
        if (!(u >= 0 && u < static_cast<float>(camera.width_px) && v >= 0 &&
              v < static_cast<float>(camera.height_px)))
            return;
        const int x = static_cast<int>(u), y = static_cast<int>(v);
        if (!mask.empty() && mask[y * camera.width_px + x] < kObjectMask) return;
        const TileSpan span = spans[y / kTileSize * grid.columns + x / kTileSize];
        float T = 1;
        for (std::uint32_t at = span.begin; at < span.end && T >= kClear; ++at) {
            const std::uint32_t i = splats[at];
            const FieldShape& s = shapes[i];
            const Vec2f w = whitened(s.root, Vec2f{s.mean.x - u, s.mean.y - v});
            if (p.z < s.front || dot(w, w) > s.reach) continue;  // true for most splats
            T *= 1 - alpha_up_to(gaussians[i], ray, p.z);
        }
        ++sight.views;
        sight.clear += T >= kClear;
    }
};

struct SeePointBody {
    FieldView view;
    Span<const Vec3f> points;
    Span<Sight> sights;

    TVSGS_HD void operator()(int i) const {
        if (sights[i].clear < kClearViews) view.look(points[i], sights[i]);
    }
};

/// Buffers that the views reuse.
template <class Device>
struct FieldScratch {
    FieldViewSplats<Device> splats;
    TileLists<Device> lists;
    Buffer<std::uint8_t, Device> mask;
};

template <class Device>
FieldView make_view(const FieldSplats<Device>& splats,
                    const FieldViews& views,
                    const View& view,
                    FieldScratch<Device>& scratch) {
    const Camera& camera = view.camera;
    const TileGrid grid = tile_grid(camera.width_px, camera.height_px);
    scratch.splats.resize(splats.means.size());
    parallel_for(Device{}, splats.size(),
                 FieldSplatBody{camera, grid, views.near, splats.means.span(), splats.scales.span(),
                                splats.quats.span(), splats.opacities.span(),
                                scratch.splats.shapes.span(), scratch.splats.features.span(),
                                scratch.splats.depths.span(), scratch.splats.rects.span()});
    build_tile_lists(scratch.splats, grid, scratch.lists);
    copy(views.masks ? view.mask.pixels.to_vector() : std::vector<std::uint8_t>(), scratch.mask);
    return {camera,
            grid,
            views.near,
            scratch.mask.span(),
            scratch.lists.spans.span(),
            scratch.lists.splats.span(),
            scratch.splats.shapes.span(),
            scratch.splats.features.span()};
}

struct MiddleBody {
    Span<const Vec3f> a, b;
    Span<Vec3f> middles;
    TVSGS_HD void operator()(int i) const { middles[i] = 0.5f * (a[i] + b[i]); }
};
struct HalveBody {
    Span<const Vec3f> middles;
    Span<const Sight> sights;
    Span<Vec3f> free_ends, inside_ends;

    TVSGS_HD void operator()(int i) const {
        (is_free(sights[i]) ? free_ends : inside_ends)[i] = middles[i];
    }
};

struct AddColorBody {
    Camera camera;
    Span<const float> depth;  // [H W] 0: none
    Span<const Vec3f> color;  // [H W]
    Span<const Vec3f> vertices;
    Span<ColorSum> sums;

    TVSGS_HD void operator()(int i) const {
        const Vec3f p = camera.camera_from_world * vertices[i];
        if (!(p.z > 0)) return;
        const float u = camera.fx_px * p.x / p.z + camera.cx_px,
                    v = camera.fy_px * p.y / p.z + camera.cy_px;
        if (!(u >= 0 && u < static_cast<float>(camera.width_px) && v >= 0 &&
              v < static_cast<float>(camera.height_px)))
            return;
        const int at = static_cast<int>(v) * camera.width_px + static_cast<int>(u);
        const float resolution = camera.fx_px / p.z, d = resolution * (p.z - depth[at]);
        if (!(depth[at] > 0) || !(d * d < 64) || !is_finite(color[at])) return;
        const float falloff = 1 / (1 + d * d), weight = resolution * resolution * falloff * falloff;
        sums[i].color += weight * color[at];
        sums[i].weight += weight;
    }
};

}  // namespace detail

template <class Device>
void see_points(const FieldSplats<Device>& splats,
                const FieldViews& views,
                const Buffer<Vec3f, Device>& points,
                Buffer<Sight, Device>& sights) {
    detail::FieldScratch<Device> scratch;
    sights.resize(points.size()), sights.fill_zero();
    const int count = static_cast<int>(points.size());
    Progress progress(str("opacity of ", count, " points"), double(views.views.size()));
    for (const View& view : views.views)
        with_context(str("opacity in view ", view.name), [&] {
            const detail::FieldView made = detail::make_view(splats, views, view, scratch);
            parallel_for(Device{}, count, detail::SeePointBody{made, points.span(), sights.span()});
            progress.advance();
        });
}

template <class Device>
void find_crossings(const FieldSplats<Device>& splats,
                    const FieldViews& views,
                    int steps,
                    Buffer<Vec3f, Device>& free_ends,
                    Buffer<Vec3f, Device>& inside_ends) {
    const int count = static_cast<int>(free_ends.size());
    Buffer<Vec3f, Device> middles(free_ends.size());
    Buffer<Sight, Device> sights;
    const auto find_middles = [&] {
        parallel_for(Device{}, count,
                     detail::MiddleBody{free_ends.span(), inside_ends.span(), middles.span()});
    };
    for (int step = 0; step < steps; ++step) {
        find_middles();
        see_points(splats, views, middles, sights);
        parallel_for(
            Device{}, count,
            detail::HalveBody{middles.span(), sights.span(), free_ends.span(), inside_ends.span()});
    }
    find_middles();
    copy(middles, free_ends), copy(middles, inside_ends);
}

template <class Device>
void add_colors(const DepthView<Device>& view,
                const Buffer<Vec3f, Device>& vertices,
                Buffer<ColorSum, Device>& sums) {
    parallel_for(
        Device{}, static_cast<int>(vertices.size()),
        detail::AddColorBody{view.camera, view.depth, view.color, vertices.span(), sums.span()});
}

/// Instantiates the functions for a device.
#define TVSGS_OPACITY_FIELD(Device)                                                  \
    template void see_points(const FieldSplats<Device>&, const FieldViews&,          \
                             const Buffer<Vec3f, Device>&, Buffer<Sight, Device>&);  \
    template void find_crossings(const FieldSplats<Device>&, const FieldViews&, int, \
                                 Buffer<Vec3f, Device>&, Buffer<Vec3f, Device>&);    \
    template void add_colors(const DepthView<Device>&, const Buffer<Vec3f, Device>&, \
                             Buffer<ColorSum, Device>&);

}  // namespace tvsgs
