// The backbone `surfel`: flat splats, whose planes intersect the rays of the pixels.  [2DGS]
#pragma once

#include "render/tiles/blend_work.h"
#include "render/tiles/tiled_backbone.h"

namespace tvsgs {

/// Surfels do not use the third scale. It is set below the others, for code that takes the smallest
/// axis as the normal, such as voting.
inline constexpr float kSurfelThickness = -6.9077554f;  // ln 0.001, relative to the smaller scale

struct ThinBody {
    Span<Vec3f> log_scales;
    TVSGS_HD void operator()(int i) const {
        Vec3f& l = log_scales[i];
        l.z = (l.x < l.y ? l.x : l.y) + kSurfelThickness;
    }
};

template <class Device>
class SurfelBackbone final : public TiledBackbone<Device> {
    using Base = TiledBackbone<Device>;
    using Base::channels_, Base::images_, Base::lists_, Base::stops_, Base::view_;

public:
    static constexpr BackboneTraits kTraits{
        .maps = Maps::color | kGeometryMaps | Maps::distortion | Maps::coverage,
        .flat = true,
        .parts_colors = true};

    explicit SurfelBackbone(const BackboneOptions& options) : Base(kTraits, options) {}

    void prepare(int, bool, const std::vector<Camera>&, Gaussians<Device>& g) override {
        parallel_for(Device{}, g.size(), ThinBody{g.log_scales.span()});
    }

    const RenderedImages<Device>& forward(const Gaussians<Device>& g,
                                          const Camera& camera,
                                          int sh_degree,
                                          Maps maps) override {
        this->begin(g, camera, sh_degree, channels_of(maps, kGeometryMaps | Maps::distortion));
        const std::size_t plane = this->plane_pixels();
        images_.distortion.resize(plane);
        z_.resize(plane), first_.resize(plane), second_.resize(plane);
        const auto project = [&](auto& to) {
            return ProjectSurfelsBody{parameters_of(g), view_, to.records(), this->share_};
        };
        this->list_splats(g, project, splats_);
        this->clock()("blend",
                      [&] { has_plane(channels_) ? blend_as<true>() : blend_as<false>(); });
        return images_;
    }

    const FusedGradients* blend_backward(const Gaussians<Device>&,
                                         const ImageGradients<Device>& dL_dimages) override {
        with_channels(channels_, [&]<Channels kChannels>() {
            constexpr bool kMaps = has_plane(kChannels);
            this->clock()("blend backward", [&] {
                this->parts_colors() ? blend_back_as<kMaps, true>(dL_dimages)
                                     : blend_back_as<kMaps, false>(dL_dimages);
            });
            this->gradients_.vjp =
                SurfelVjp<kChannels>{view_, splats_.shapes.span(), splats_.features.span(),
                                     this->sums(fragments_of<kMaps>())};
        });
        return &this->gradients_;
    }

    BlendWork blend_work() const override {
        return count_blend_work<SurfelModel<false>>(splats_, lists_, view_.grid);
    }

private:
    template <bool kMaps>
    void blend_as() {
        blend_tiles<SurfelModel<kMaps>>(
            splats_, lists_, view_.grid,
            {images_.color.span(), images_.normal.span(), images_.transmittance.span(),
             images_.depth.span(), images_.distortion.span(), z_.span(), first_.span(),
             second_.span(), images_.width, this->median()},
            stops_);
    }
    template <bool kMaps, bool kParted>
    void blend_back_as(const ImageGradients<Device>& dL) {
        const RenderedImages<Device>& images = images_;
        blend_tiles_vjp<SurfelModel<kMaps, kParted>>(
            splats_, lists_, view_.grid,
            {dL.color.span(), dL.normal.span(), dL.depth.span(), dL.distortion.span(),
             images.transmittance.span(), images.depth.span(), z_.span(), first_.span(),
             second_.span(), this->median(), dL.transmittance.span()},
            images.transmittance, stops_, fragments_of<kMaps>());
    }

    template <bool kMaps>
    auto& fragments_of() {
        if constexpr (kMaps)
            return map_fragments_;
        else
            return color_fragments_;
    }

    Surfels<Device> splats_;
    Buffer<float, Device> z_, first_, second_;  // [H W] as in SurfelPixel
    FragmentGradients<Device, SurfelGradients<false, float>> color_fragments_;
    FragmentGradients<Device, SurfelGradients<true, float>> map_fragments_;
};

}  // namespace tvsgs
