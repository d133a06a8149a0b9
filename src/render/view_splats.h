// The splats of one view: per-Gaussian projection and its backward, one body for both devices.
#pragma once

#include <cstdint>

#include "render/blend_math.h"
#include "render/projection_math.h"
#include "render/sh_math.h"

namespace tvsgs {

inline constexpr int kTileSize = 16;  // px

/// Tiles of an image.
struct TileGrid {
    int width, height, columns, rows;

    TVSGS_HD int count() const { return columns * rows; }
};

inline TileGrid tile_grid(int width, int height) {
    return {width, height, (width + kTileSize - 1) / kTileSize,
            (height + kTileSize - 1) / kTileSize};
}

/// Tiles [x0, x1) x [y0, y1).
struct TileRect {
    std::uint16_t x0, y0, x1, y1;
};

/// Projected Gaussians, all [N]; entries of invisible ones (touched == 0) are undefined.
template <class Device>
struct ViewSplats {
    Buffer<SplatShape<float>, Device> shapes;
    Buffer<SplatFeatures<float>, Device> features;
    Buffer<float, Device> depths;  // z in the camera frame
    Buffer<TileRect, Device> rects;
    Buffer<std::uint64_t, Device> touched;  // tiles that the ellipse meets

    void resize(std::size_t n) {
        shapes.resize(n), features.resize(n), depths.resize(n), rects.resize(n), touched.resize(n);
    }
};

/// Largest and smallest pixel centre of a tile, clipped to the image.
TVSGS_HD inline bool ellipse_meets_tile(const SplatShape<float>& shape,
                                        const TileGrid& grid,
                                        int tx,
                                        int ty) {
    const float x0 = static_cast<float>(tx * kTileSize) + 0.5f,
                y0 = static_cast<float>(ty * kTileSize) + 0.5f;
    const float x1 =
        static_cast<float>(tx * kTileSize + kTileSize < grid.width ? tx * kTileSize + kTileSize
                                                                   : grid.width) -
        0.5f;
    const float y1 =
        static_cast<float>(ty * kTileSize + kTileSize < grid.height ? ty * kTileSize + kTileSize
                                                                    : grid.height) -
        0.5f;
    // Alpha reaches kMinAlpha where the quadratic form is at most 2 ln(255 opacity). A little
    // slack: rounding here may only add tiles.
    const float reach = 2 * std::log(shape.opacity / kMinAlpha);
    return least_quadratic(shape, {x0, y0}, {x1, y1}) <= reach * 1.0001f + 1e-4f;
}

/// What the projection of a Gaussian needs to know of the view.
struct ViewParameters {
    Pinhole<float> camera;
    Vec3f centre;  // of the camera, world
    TileGrid grid;
    int sh_degree;
    float near, low_pass;
    bool exact_clamp;
};

template <Channels kChannels>
struct ProjectBody {
    ViewParameters view;
    Span<const Vec3f> means, log_scales;
    Span<const Quatf> quats;
    Span<const float> opacity_logits;
    Span<const Vec3f> sh;
    Span<SplatShape<float>> shapes;
    Span<SplatFeatures<float>> features;
    Span<float> depths;
    Span<TileRect> rects;
    Span<std::uint64_t> touched;
    Span<float> radii;

    TVSGS_HD void operator()(int i) const {
        touched[i] = 0;
        radii[i] = 0;
        const Vec3f p = view.camera.camera_from_world * means[i];
        if (!(p.z > view.near) || !is_finite(p)) return;
        const float opacity = 1 / (1 + std::exp(-opacity_logits[i]));
        if (!(opacity > kMinAlpha)) return;  // nowhere visible

        const Mat3f R = rotation(normalize(quats[i]));
        const Vec3f scales = exp(log_scales[i]);
        Sym2f C = project_covariance(projection_jacobian(view.camera, p), covariance(R, scales));
        C.xx += view.low_pass, C.yy += view.low_pass;
        const float det = C.xx * C.yy - C.xy * C.xy;
        if (!(det > 0) || !(det < 1e30f)) return;

        SplatShape<float> s;
        s.mean = project_point(view.camera, p);
        s.conic = conic(C, det);
        s.opacity = opacity;
        const float reach = 2 * std::log(opacity / kMinAlpha);
        s.extent = {std::sqrt(reach * C.xx), std::sqrt(reach * C.yy)};
        const TileGrid& grid = view.grid;
        const auto tile_range = [](float low, float high, int tiles, std::uint16_t& first,
                                   std::uint16_t& last) {
            const float size = kTileSize, most = static_cast<float>(tiles);
            first = static_cast<std::uint16_t>(clamp(std::floor(low / size), 0.0f, most));
            last = static_cast<std::uint16_t>(clamp(std::floor(high / size) + 1, 0.0f, most));
        };
        TileRect rect;
        tile_range(s.mean.x - s.extent.x, s.mean.x + s.extent.x, grid.columns, rect.x0, rect.x1);
        tile_range(s.mean.y - s.extent.y, s.mean.y + s.extent.y, grid.rows, rect.y0, rect.y1);
        std::uint64_t count = 0;
        for (int ty = rect.y0; ty < rect.y1; ++ty)
            for (int tx = rect.x0; tx < rect.x1; ++tx) count += ellipse_meets_tile(s, grid, tx, ty);
        if (count == 0) return;

        // The 3-sigma radius of 3DGS: statistics only, the tiles come from the exact test.
        const float mid = 0.5f * (C.xx + C.yy);
        const float under_root = mid * mid - det;
        radii[i] = std::ceil(3 * std::sqrt(mid + std::sqrt(under_root > 0.1f ? under_root : 0.1f)));
        shapes[i] = s;
        depths[i] = p.z;
        rects[i] = rect;
        touched[i] = count;

        SplatFeatures<float> f{};
        if constexpr (has_color(kChannels))
            f.color = sh_color<float>(view.sh_degree, normalize(means[i] - view.centre), sh.data,
                                      means.count, i);
        if constexpr (has_plane(kChannels)) {
            const CameraPlane<float> plane =
                camera_plane(view.camera.camera_from_world.R, R, smallest_axis(log_scales[i]), p);
            f.normal = plane.normal;
            f.distance = plane.distance;
        }
        features[i] = f;
    }
};

/// Adds up the tile gradients of a Gaussian in the order of its tiles and carries them to its
/// parameters.
template <Channels kChannels>
struct ProjectBackwardBody {
    ViewParameters view;
    Span<const Vec3f> means, log_scales;
    Span<const Quatf> quats;
    Span<const Vec3f> sh;
    Span<const SplatShape<float>> shapes;
    Span<const SplatFeatures<float>> features;
    Span<const std::uint64_t> touched, first_slot;
    Span<const SplatGradients<float>> slots;
    Span<Vec3f> dL_dmeans, dL_dlog_scales;  // added to, as all below
    Span<Quatf> dL_dquats;
    Span<float> dL_dopacity_logits;
    Span<Vec3f> dL_dsh;
    Span<Vec2f> stat_grad, stat_abs;  // overwritten
    Span<int> stat_front;

    TVSGS_HD void operator()(int i) const {
        stat_grad[i] = stat_abs[i] = {};
        stat_front[i] = 0;
        if (touched[i] == 0) return;
        SplatGradients<float> g{};
        for (std::uint64_t slot = first_slot[i]; slot < first_slot[i] + touched[i]; ++slot) {
            const SplatGradients<float>& s = slots[slot];
            g.mean += s.mean;
            g.abs_mean += s.abs_mean;
            g.conic.xx += s.conic.xx, g.conic.xy += s.conic.xy, g.conic.yy += s.conic.yy;
            g.opacity += s.opacity;
            add_features<kChannels>(g.features, 1.0f, s.features);
            g.front_pixels += s.front_pixels;
        }
        const float half_w = 0.5f * static_cast<float>(view.grid.width),
                    half_h = 0.5f * static_cast<float>(view.grid.height);
        stat_grad[i] = {half_w * g.mean.x, half_h * g.mean.y};
        stat_abs[i] = {half_w * g.abs_mean.x, half_h * g.abs_mean.y};
        stat_front[i] = static_cast<int>(g.front_pixels);

        const Vec3f p = view.camera.camera_from_world * means[i];
        const Mat3f R = rotation(normalize(quats[i]));
        const Vec3f scales = exp(log_scales[i]);
        const float opacity = shapes[i].opacity;
        dL_dopacity_logits[i] += opacity * (1 - opacity) * g.opacity;

        const Sym2f dL_dcovariance2d =
            conic_vjp(shapes[i].conic, Sym2f{g.conic.xx, 0.5f * g.conic.xy, g.conic.yy});
        const auto projection = projection_vjp(view.camera, p, covariance(R, scales), g.mean,
                                               dL_dcovariance2d, view.exact_clamp);
        auto spread = covariance_vjp(R, scales, projection.dL_dcovariance);
        Vec3f dL_dp = projection.dL_dmean_camera;
        if constexpr (has_plane(kChannels)) {
            const int axis = smallest_axis(log_scales[i]);
            const auto plane = camera_plane_vjp(view.camera.camera_from_world.R, R, axis, p,
                                                g.features.normal, g.features.distance);
            dL_dp += plane.dL_dmean_camera;
            for (int row = 0; row < 3; ++row) spread.dL_dR[row][axis] += plane.dL_daxis[row];
        }
        Vec3f dL_dmean = transpose_times(view.camera.camera_from_world.R, dL_dp);
        if constexpr (has_color(kChannels))
            dL_dmean +=
                sh_color_vjp<float>(view.sh_degree, means[i] - view.centre, sh.data, means.count, i,
                                    features[i].color, g.features.color, dL_dsh.data);
        dL_dmeans[i] += dL_dmean;
        dL_dlog_scales[i] += scales * spread.dL_ds;
        const Quatf dL_dquat = rotation_vjp(quats[i], spread.dL_dR);
        dL_dquats[i].w += dL_dquat.w, dL_dquats[i].x += dL_dquat.x;
        dL_dquats[i].y += dL_dquat.y, dL_dquats[i].z += dL_dquat.z;
    }
};

}  // namespace tvsgs
