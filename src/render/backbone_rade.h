// Ellipses whose distance slopes across the image as their density does, under a smoothing filter:
// the backbone `rade`.  [RaDe-GS], filter: [Yu24]
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/parallel.h"
#include "core/smoothing_filter.h"
#include "render/blend_rade.h"
#include "render/rade_math.h"
#include "render/view_splats.h"

namespace tvsgs {

/// The depth of each splat in the nearest view that has it, 0 where none has.
struct NearestDepthBody {
    Span<const Pinhole<float>> cameras;
    float near;
    Span<const Vec3f> means;
    Span<float> depths;  // overwritten

    TVSGS_HD void operator()(int i) const {
        float nearest = 0;
        for (std::size_t c = 0; c < cameras.count; ++c) {
            const float z = depth_in_view(cameras[c], near, means[i]);
            if (z > 0 && !(nearest > 0 && nearest <= z)) nearest = z;
        }
        depths[i] = nearest;
    }
};

/// Depths to filters.
struct SmoothingFilterBody {
    float unseen_depth, longest_fx;
    Span<float> filter;
    TVSGS_HD void operator()(int i) const {
        filter[i] = filter_of(filter[i] > 0 ? filter[i] : unseen_depth, longest_fx);
    }
};

/// Parameters, all [N]; `filter` may be empty.
struct RadeSplats {
    Span<const Vec3f> means, log_scales;
    Span<const Quatf> quats;
    Span<const float> opacity_logits;
    Span<const Vec3f> sh;
    Span<const float> filter;

    template <class Device>
    explicit RadeSplats(const Gaussians<Device>& g)
        : means(g.means.span()),
          log_scales(g.log_scales.span()),
          quats(g.quats.span()),
          opacity_logits(g.opacity_logits.span()),
          sh(g.sh.span()),
          filter(g.filter.span()) {}

    TVSGS_HD SmoothedSplat<float> smoothed_at(int i) const {
        return smoothed(log_scales[i], filter.empty() ? 0.0f : filter[i]);
    }
};

/// Below this determinant in the image, px^4, the official code draws nothing.
inline constexpr float kLeastRadeDet = 1e-6f;

struct ProjectRadeBody {
    ViewParameters view;
    bool color, maps;
    RadeSplats splats;
    Span<SplatShape<float>> shapes;
    Span<RadeRecord> features;
    Span<float> depths;
    Span<TileRect> rects;
    Span<float> radii;

    TVSGS_HD void operator()(int i) const {
        rects[i] = {};
        radii[i] = 0;
        const Mat3f& to_camera = view.camera.camera_from_world.R;
        const Vec3f mean = splats.means[i], p = view.camera.camera_from_world * mean;
        if (!(p.z > view.near) || !is_finite(p)) return;
        const SmoothedSplat<float> smooth = splats.smoothed_at(i);
        const float opacity = smooth.dimming * sigmoid(splats.opacity_logits[i]);
        if (!(opacity > view.cull_alpha)) return;

        const Mat3f R = rotation(normalize(splats.quats[i]));
        const ViewEllipse e = view_ellipse(view, p, R, smooth.scales, opacity, kLeastRadeDet);
        if (e.rect.count() == 0) return;
        shapes[i] = e.shape;
        depths[i] = p.z;
        rects[i] = e.rect;
        radii[i] = e.radius;
        RadeRecord& out = features[i];
        out.f.color = color ? sh_color<float>(view.sh_degree, normalize(mean - view.centre),
                                              splats.sh.data, splats.means.count, i)
                            : Vec3f{};
        if (!maps) return;
        const auto plane = rade_plane(view.camera, {to_camera * R, smooth.scales}, p);
        out.f.normal = plane.normal, out.f.distance = plane.distance;
        out.slope = plane.slope;
    }
};

/// Statistics and gradients of the splats, from those of their pixels.
struct RadeBackwardBody {
    ViewParameters view;
    bool color, maps;
    RadeSplats splats;
    Span<const SplatShape<float>> shapes;
    Span<const RadeRecord> features;
    Span<const std::uint32_t> fragment_counts, first_fragment;
    Span<const RadeGradients<float>> fragments;
    Span<const std::uint8_t> drawn;
    Span<Vec2f> stat_grad, stat_abs;  // overwritten
    Span<int> stat_front;
    Span<Vec3f> dL_dmeans, dL_dlog_scales;  // added to; empty: the statistics alone are asked for
    Span<Quatf> dL_dquats;
    Span<float> dL_dopacity_logits;
    Span<Vec3f> dL_dsh;

    TVSGS_HD void operator()(int i) const {
        stat_grad[i] = stat_abs[i] = {};
        stat_front[i] = 0;
        if (fragment_counts[i] == 0 || !drawn[first_fragment[i]]) return;
        const SplatShape<float> shape = shapes[i];
        RadeGradients<float> sums = fragments[first_fragment[i]];
        SplatGradients<float>& g = sums.of;
        complete(g, shape);
        if (maps) g.mean += g.features.distance * features[i].slope;
        const float half_w = 0.5f * static_cast<float>(view.grid.width),
                    half_h = 0.5f * static_cast<float>(view.grid.height);
        stat_grad[i] = {half_w * g.mean.x, half_h * g.mean.y};
        stat_abs[i] = {half_w * g.abs_mean.x, half_h * g.abs_mean.y};
        stat_front[i] = static_cast<int>(g.front_pixels);
        if (!dL_dmeans.empty()) to_parameters(i, shape, sums);
    }

private:
    TVSGS_HD void to_parameters(int i,
                                const SplatShape<float>& shape,
                                const RadeGradients<float>& sums) const {
        const SplatGradients<float>& g = sums.of;
        const Vec3f mean = splats.means[i], p = view.camera.camera_from_world * mean;
        const Mat3f& to_camera = view.camera.camera_from_world.R;
        const Mat3f R = rotation(normalize(splats.quats[i]));
        const SmoothedSplat<float> smooth = splats.smoothed_at(i);

        auto ellipse = image_ellipse_vjp(projection_jacobian(view.camera, p), R, smooth.scales,
                                         shape.root, g.spread);
        Vec3f dL_dp = projection_vjp(view.camera, p, g.mean, ellipse.dL_dT, view.exact_clamp);
        if (maps) {
            const auto plane = rade_plane_vjp(view.camera, {to_camera * R, smooth.scales}, p,
                                              {g.features.normal, sums.slope, g.features.distance});
            dL_dp += plane.dL_dp;
            ellipse.dL_dlog_s += plane.dL_dlog_scales;
            const Mat3f by_R = transpose(to_camera) * plane.dL_daxes;
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c) ellipse.dL_dR[r][c] += by_R[r][c];
        }
        dL_dlog_scales[i] += smoothed_vjp(smooth, shape.opacity, ellipse.dL_dlog_s, g.opacity);
        dL_dopacity_logits[i] +=
            smooth.dimming * sigmoid_slope(splats.opacity_logits[i]) * g.opacity;
        add(dL_dquats[i], rotation_vjp(splats.quats[i], ellipse.dL_dR));
        Vec3f dL_dmean = transpose_times(to_camera, dL_dp);
        if (color) {
            AddShGradient<float> visit{splats.sh.data, dL_dsh.data, splats.means.count,
                                       static_cast<std::size_t>(i)};
            dL_dmean += sh_color_vjp<float>(view.sh_degree, mean - view.centre, features[i].f.color,
                                            g.features.color, visit);
        }
        dL_dmeans[i] += dL_dmean;
    }
};

template <class Device>
class RadeBackbone final : public Backbone<Device> {
public:
    explicit RadeBackbone(const BackboneOptions& options) : options_(options) {}

    bool fades_thin_splats() const override { return true; }

    Maps maps() const override { return Maps::color | kGeometryMaps | Maps::expected_depth; }

    /// The filter is computed at first and where splats have come and gone, and now and then once
    /// growth has ended, at the published iterations whatever the length of the run.
    void prepare(int step,
                 bool changed,
                 const std::vector<Camera>& cameras,
                 Gaussians<Device>& g) override {
        const bool refresh = step > kRefreshAfter && step < kRefreshBefore && step % 100 == 0;
        if (!changed && !refresh) return;
        std::vector<Pinhole<float>> pinholes;
        float longest_fx = std::numeric_limits<float>::min();  // no cameras: no filter
        for (const Camera& camera : cameras) {
            pinholes.push_back(pinhole<float>(camera));
            longest_fx = std::max(longest_fx, camera.fx_px);
        }
        copy(pinholes, cameras_);
        g.filter.resize(g.means.size());
        parallel_for(Device{}, g.size(),
                     NearestDepthBody{std::as_const(cameras_).span(), options_.near,
                                      std::as_const(g.means).span(), g.filter.span()});
        float farthest = 0;
        for (const float depth : to_host(g.filter)) farthest = std::max(farthest, depth);
        parallel_for(Device{}, g.size(),
                     SmoothingFilterBody{farthest, longest_fx, g.filter.span()});
    }

    const RenderedImages<Device>& forward(const Gaussians<Device>& g,
                                          const Camera& camera,
                                          int sh_degree,
                                          Maps maps) override {
        color_ = has(maps, Maps::color);
        maps_ = has(maps, kGeometryMaps | Maps::expected_depth);
        view_ = {pinhole<float>(camera),
                 camera_centre(camera),
                 tile_grid(camera.width_px, camera.height_px),
                 sh_degree < g.sh_degree ? sh_degree : g.sh_degree,
                 options_.near,
                 /*low_pass=*/0,  // the filter stands in for it
                 options_.cull_alpha,
                 options_.exact_clamp_grad};
        resize_images(camera);
        splats_.resize(g.means.size());
        statistics_.radii_px.resize(g.means.size());
        auto& clock = this->clock();
        clock("project", [&] {
            parallel_for(Device{}, g.size(),
                         ProjectRadeBody{view_, color_, maps_, RadeSplats(g), splats_.shapes.span(),
                                         splats_.features.span(), splats_.depths.span(),
                                         splats_.rects.span(), statistics_.radii_px.span()});
        });
        clock("tile lists", [&] { build_tile_lists(splats_, view_.grid, lists_); });
        clock("blend", [&] { maps_ ? blend_as<true>() : blend_as<false>(); });
        return images_;
    }

    void backward(const Gaussians<Device>& g,
                  const ImageGradients<Device>& dL_dimages,
                  Gaussians<Device>& dL) override {
        go_back(g, dL_dimages, &dL);
    }
    void observe(const Gaussians<Device>& g) override { go_back(g, {}, nullptr); }

    const ScreenStatistics<Device>& statistics() const override { return statistics_; }
    RenderCounts counts() const override { return {lists_.visible_count, lists_.fragment_count}; }
    void use_atomic_sums() override { fragments_.atomic = true; }

private:
    static constexpr int kRefreshAfter = 15000, kRefreshBefore = 29900;

    void resize_images(const Camera& camera) {
        const std::size_t pixels = std::size_t(camera.width_px) * std::size_t(camera.height_px),
                          geometry = maps_ ? pixels : 0;
        images_.width = camera.width_px, images_.height = camera.height_px;
        images_.camera = camera;
        images_.color.resize(color_ ? pixels : 0);
        images_.transmittance.resize(pixels), stops_.resize(pixels);
        images_.normal.resize(geometry), images_.depth.resize(geometry);
        images_.expected_depth.resize(geometry), normal_length_.resize(geometry);
    }

    template <bool kMaps>
    void blend_as() {
        blend_tiles<RadeModel<kMaps>>(
            splats_, lists_, view_.grid,
            {images_.camera, images_.color.span(), images_.normal.span(),
             images_.transmittance.span(), images_.depth.span(), images_.expected_depth.span(),
             normal_length_.span(), median()},
            stops_);
    }
    template <bool kMaps>
    void blend_back_as(const ImageGradients<Device>& dL) {
        const RenderedImages<Device>& images = images_;
        blend_tiles_vjp<RadeModel<kMaps>>(
            splats_, lists_, view_.grid,
            {images.camera, dL.color.span(), dL.normal.span(), dL.depth.span(),
             dL.expected_depth.span(), images.normal.span(), images.transmittance.span(),
             images.depth.span(), images.expected_depth.span(),
             std::as_const(normal_length_).span(), median()},
            images.transmittance, stops_, fragments_);
    }

    /// `dL`: null where only the statistics are asked for.
    void go_back(const Gaussians<Device>& g,
                 const ImageGradients<Device>& dL_dimages,
                 Gaussians<Device>* dL) {
        this->clock()("blend backward", [&] {
            maps_ ? blend_back_as<true>(dL_dimages) : blend_back_as<false>(dL_dimages);
        });
        const std::size_t n = g.means.size();
        statistics_.dL_dmeans2d.resize(n);
        statistics_.abs_dL_dmeans2d.resize(n);
        statistics_.front_pixels.resize(n);
        const FragmentGradients<Device, RadeGradients<float>>& fragments = fragments_;
        RadeBackwardBody body{view_,
                              color_,
                              maps_,
                              RadeSplats(g),
                              std::as_const(splats_.shapes).span(),
                              std::as_const(splats_.features).span(),
                              std::as_const(lists_.fragment_counts).span(),
                              std::as_const(lists_.first_fragment).span(),
                              fragments.gradients.span(),
                              fragments.drawn.span(),
                              statistics_.dL_dmeans2d.span(),
                              statistics_.abs_dL_dmeans2d.span(),
                              statistics_.front_pixels.span(),
                              {},
                              {},
                              {},
                              {},
                              {}};
        if (dL != nullptr) {
            body.dL_dmeans = dL->means.span(), body.dL_dlog_scales = dL->log_scales.span();
            body.dL_dquats = dL->quats.span(), body.dL_dsh = dL->sh.span();
            body.dL_dopacity_logits = dL->opacity_logits.span();
        }
        this->clock()("project backward", [&] { parallel_for(Device{}, g.size(), body); });
    }

    bool median() const { return options_.depth != SurfaceDepth::expected; }

    BackboneOptions options_;
    bool color_ = true, maps_ = false;  // of the last forward()
    ViewParameters view_{};
    Buffer<Pinhole<float>, Device> cameras_;  // of the last prepare() that needed them
    ViewSplats<Device, SplatShape<float>, RadeRecord> splats_;
    TileLists<Device> lists_;
    RenderedImages<Device> images_;
    Buffer<float, Device> normal_length_;  // [H W] before it was normalised
    Buffer<std::uint32_t, Device> stops_;  // [H W] see blend_tiles()
    ScreenStatistics<Device> statistics_;
    FragmentGradients<Device, RadeGradients<float>> fragments_;
};

}  // namespace tvsgs
