// The backbone `rade`: ellipses with a sloping distance, and a smoothing filter.  [RaDe-GS],
// filter: [Yu24]
#pragma once

#include <algorithm>
#include <limits>

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

struct SmoothingFilterBody {
    float unseen_depth, longest_fx;
    Span<float> filter;
    TVSGS_HD void operator()(int i) const {
        filter[i] = filter_of(filter[i] > 0 ? filter[i] : unseen_depth, longest_fx);
    }
};

template <class Device>
class RadeBackbone final : public TiledBackbone<Device> {
    using Base = TiledBackbone<Device>;
    using Base::channels_, Base::images_, Base::lists_, Base::options_, Base::stops_, Base::view_;

public:
    static constexpr BackboneTraits kTraits{
        .maps = Maps::color | kGeometryMaps | Maps::expected_depth | Maps::coverage,
        .fades_thin_splats = true};

    explicit RadeBackbone(const BackboneOptions& options) : Base(kTraits, options) {}

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
        parallel_for(
            Device{}, g.size(),
            NearestDepthBody{cameras_.span(), options_.near, g.means.span(), g.filter.span()});
        float farthest = 0;
        for (const float depth : to_host(g.filter)) farthest = std::max(farthest, depth);
        parallel_for(Device{}, g.size(),
                     SmoothingFilterBody{farthest, longest_fx, g.filter.span()});
    }

    const RenderedImages<Device>& forward(const Gaussians<Device>& g,
                                          const Camera& camera,
                                          int sh_degree,
                                          Maps maps) override {
        // The filter replaces the low-pass.
        this->begin(g, camera, sh_degree, channels_of(maps, kGeometryMaps | Maps::expected_depth));
        images_.expected_depth.resize(this->plane_pixels());
        normal_length_.resize(this->plane_pixels());
        const auto project = [&](auto& to) {
            return ProjectRadeBody{parameters_of(g), view_, to.records(), g.filter.span(),
                                   has_plane(channels_)};
        };
        this->list_splats(g, project, splats_);
        this->clock()("blend",
                      [&] { has_plane(channels_) ? blend_as<true>() : blend_as<false>(); });
        return images_;
    }

    const FusedGradients* blend_backward(const Gaussians<Device>& g,
                                         const ImageGradients<Device>& dL_dimages) override {
        with_channels(channels_, [&]<Channels kChannels>() {
            this->clock()("blend backward",
                          [&] { blend_back_as<has_plane(kChannels)>(dL_dimages); });
            this->gradients_.vjp =
                RadeVjp<kChannels>{view_, splats_.shapes.span(), splats_.features.span(),
                                   this->sums(fragments_), g.filter.span()};
        });
        return &this->gradients_;
    }

private:
    static constexpr int kRefreshAfter = 15000, kRefreshBefore = 29900;

    template <bool kMaps>
    void blend_as() {
        blend_tiles<RadeModel<kMaps>>(
            splats_, lists_, view_.grid,
            {images_.camera, images_.color.span(), images_.normal.span(),
             images_.transmittance.span(), images_.depth.span(), images_.expected_depth.span(),
             normal_length_.span(), this->median()},
            stops_);
    }
    template <bool kMaps>
    void blend_back_as(const ImageGradients<Device>& dL) {
        const RenderedImages<Device>& images = images_;
        blend_tiles_vjp<RadeModel<kMaps>>(
            splats_, lists_, view_.grid,
            {images.camera, dL.color.span(), dL.normal.span(), dL.depth.span(),
             dL.expected_depth.span(), images.normal.span(), images.transmittance.span(),
             images.depth.span(), images.expected_depth.span(), normal_length_.span(),
             this->median(), dL.transmittance.span()},
            images.transmittance, stops_, fragments_);
    }

    Buffer<Pinhole<float>, Device> cameras_;  // of the last prepare() that needed them
    ViewSplats<Device, SplatShape<float>, RadeRecord> splats_;
    Buffer<float, Device> normal_length_;  // [H W] before normalisation
    FragmentGradients<Device, RadeGradients<float>> fragments_;
};

}  // namespace tvsgs
