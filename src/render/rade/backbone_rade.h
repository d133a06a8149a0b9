// The backbone `rade`: ellipses with a sloping distance, and a smoothing filter.  [RaDe-GS],
// filter: [Yu24]
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "render/tiles/channels.h"
#include "render/tiles/tiled_backbone.h"

namespace tvsgs {

/// Writes the depth of each splat in the nearest view that contains it; 0 if none does.
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

/// Converts depths to filters.
struct SmoothingFilterBody {
    float unseen_depth, longest_fx;
    Span<float> filter;
    TVSGS_HD void operator()(int i) const {
        filter[i] = filter_of(filter[i] > 0 ? filter[i] : unseen_depth, longest_fx);
    }
};

template <class Device>
class RadeBackbone final : public TiledBackbone<Device> {
public:
    static constexpr BackboneTraits kTraits{
        .maps = Maps::color | kGeometryMaps | Maps::expected_depth | Maps::coverage,
        .fades_thin_splats = true};

    explicit RadeBackbone(const BackboneOptions& options)
        : TiledBackbone<Device>(kTraits), options_(options) {}

    /// Computes the filter at the beginning, after splats were added or removed, and every 100
    /// steps after growth has ended, at the published iterations for any length of the run.
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
        maps_ = has(maps, kGeometryMaps | Maps::expected_depth);
        color_ = has(maps, Maps::color) || !maps_;
        view_ = {pinhole<float>(camera),
                 camera_centre(camera),
                 tile_grid(camera.width_px, camera.height_px),
                 sh_degree < g.sh_degree ? sh_degree : g.sh_degree,
                 options_.near,
                 /*low_pass=*/0};  // the filter replaces it
        resize_images(camera);
        const auto project = [&](auto& to) {
            return ProjectRadeBody{view_,
                                   maps_,
                                   g.means.span(),
                                   g.log_scales.span(),
                                   g.quats.span(),
                                   g.opacity_logits.span(),
                                   g.filter.span(),
                                   to.shapes.span(),
                                   to.features.span(),
                                   to.depths.span(),
                                   to.rects.span()};
        };
        std::optional<ViewColors> colors;
        if (color_) colors = {view_.centre, view_.sh_degree};
        this->list_splats(g, view_.grid, project, colors, splats_);
        this->clock()("blend", [&] { maps_ ? blend_as<true>() : blend_as<false>(); });
        return images_;
    }

    const FusedGradients* blend_backward(const Gaussians<Device>& g,
                                         const ImageGradients<Device>& dL_dimages) override {
        with_maps(maps_, color_, [&]<bool kMaps, bool kColor>() {
            this->clock()("blend backward", [&] { blend_back_as<kMaps>(dL_dimages); });
            gradients_.vjp = RadeVjp<kMaps, kColor>{view_, std::as_const(splats_.shapes).span(),
                                                    std::as_const(splats_.features).span(),
                                                    this->sums(fragments_), g.filter.span()};
        });
        return &gradients_;
    }

    void use_atomic_sums() override { fragments_.atomic = true; }

private:
    using TiledBackbone<Device>::images_, TiledBackbone<Device>::lists_,
        TiledBackbone<Device>::statistics_, TiledBackbone<Device>::stops_,
        TiledBackbone<Device>::gradients_;

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
             std::as_const(normal_length_).span(), median(), dL.transmittance.span()},
            images.transmittance, stops_, fragments_);
    }

    bool median() const { return options_.depth != SurfaceDepth::expected; }

    BackboneOptions options_;
    bool color_ = true, maps_ = false;  // of the last forward()
    ViewParameters view_{};
    Buffer<Pinhole<float>, Device> cameras_;  // of the last prepare() that needed them
    ViewSplats<Device, SplatShape<float>, RadeRecord> splats_;
    Buffer<float, Device> normal_length_;  // [H W] before normalisation
    FragmentGradients<Device, RadeGradients<float>> fragments_;
};

}  // namespace tvsgs
