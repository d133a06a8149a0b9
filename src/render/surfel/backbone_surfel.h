// The backbone `surfel`: flat splats, whose planes intersect the rays of the pixels.  [2DGS]
#pragma once

#include "render/tiles/blend_work.h"
#include "render/tiles/channels.h"
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
public:
    static constexpr BackboneTraits kTraits{
        .maps = Maps::color | kGeometryMaps | Maps::distortion | Maps::coverage,
        .flat = true,
        .parts_colors = true};

    explicit SurfelBackbone(const BackboneOptions& options)
        : TiledBackbone<Device>(kTraits), options_(options) {}

    void prepare(int, bool, const std::vector<Camera>&, Gaussians<Device>& g) override {
        parallel_for(Device{}, g.size(), ThinBody{g.log_scales.span()});
    }

    const RenderedImages<Device>& forward(const Gaussians<Device>& g,
                                          const Camera& camera,
                                          int sh_degree,
                                          Maps maps) override {
        maps_ = has(maps, kGeometryMaps | Maps::distortion);
        color_ = has(maps, Maps::color) || !maps_;
        view_ = {pinhole<float>(camera), camera_centre(camera),
                 tile_grid(camera.width_px, camera.height_px),
                 sh_degree < g.sh_degree ? sh_degree : g.sh_degree, options_.near};
        resize_images(camera);
        const ColorShare share{g.uncertainty.span(), this->color_share_};
        parted_ = color_ && share.parts();
        const auto project = [&](auto& to) {
            return ProjectSurfelsBody{view_,
                                      g.means.span(),
                                      g.log_scales.span(),
                                      g.quats.span(),
                                      g.opacity_logits.span(),
                                      share,
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

    const FusedGradients* blend_backward(const Gaussians<Device>&,
                                         const ImageGradients<Device>& dL_dimages) override {
        with_maps(maps_, color_, [&]<bool kMaps, bool kColor>() {
            this->clock()("blend backward", [&] {
                parted_ ? blend_back_as<kMaps, true>(dL_dimages)
                        : blend_back_as<kMaps, false>(dL_dimages);
            });
            gradients_.vjp = SurfelVjp<kMaps, kColor>{view_, std::as_const(splats_.shapes).span(),
                                                      std::as_const(splats_.features).span(),
                                                      this->sums(fragments_of<kMaps>())};
        });
        return &gradients_;
    }

    BlendWork blend_work() const override {
        return count_blend_work<SurfelModel<false>>(splats_, lists_, view_.grid);
    }
    void use_atomic_sums() override { color_fragments_.atomic = map_fragments_.atomic = true; }

private:
    using TiledBackbone<Device>::images_, TiledBackbone<Device>::lists_,
        TiledBackbone<Device>::statistics_, TiledBackbone<Device>::stops_,
        TiledBackbone<Device>::gradients_;

    void resize_images(const Camera& camera) {
        const std::size_t pixels = std::size_t(camera.width_px) * std::size_t(camera.height_px),
                          maps = maps_ ? pixels : 0;
        images_.width = camera.width_px, images_.height = camera.height_px;
        images_.camera = camera;
        images_.color.resize(color_ ? pixels : 0);
        images_.transmittance.resize(pixels);
        images_.normal.resize(maps), images_.depth.resize(maps), images_.distortion.resize(maps);
        z_.resize(maps), first_.resize(maps), second_.resize(maps);
        stops_.resize(pixels);
    }

    template <bool kMaps>
    void blend_as() {
        blend_tiles<SurfelModel<kMaps>>(
            splats_, lists_, view_.grid,
            {images_.color.span(), images_.normal.span(), images_.transmittance.span(),
             images_.depth.span(), images_.distortion.span(), z_.span(), first_.span(),
             second_.span(), images_.width, median()},
            stops_);
    }
    template <bool kMaps, bool kParted>
    void blend_back_as(const ImageGradients<Device>& dL) {
        const RenderedImages<Device>& images = images_;
        blend_tiles_vjp<SurfelModel<kMaps, kParted>>(
            splats_, lists_, view_.grid,
            {dL.color.span(), dL.normal.span(), dL.depth.span(), dL.distortion.span(),
             images.transmittance.span(), images.depth.span(), std::as_const(z_).span(),
             std::as_const(first_).span(), std::as_const(second_).span(), median(),
             dL.transmittance.span()},
            images.transmittance, stops_, fragments_of<kMaps>());
    }

    template <bool kMaps>
    auto& fragments_of() {
        if constexpr (kMaps)
            return map_fragments_;
        else
            return color_fragments_;
    }

    bool median() const { return options_.depth != SurfaceDepth::expected; }

    BackboneOptions options_;
    bool color_ = true, maps_ = false, parted_ = false;  // of the last forward()
    SurfelView view_{};
    Surfels<Device> splats_;
    Buffer<float, Device> z_, first_, second_;  // [H W] as in SurfelPixel
    FragmentGradients<Device, SurfelGradients<false, float>> color_fragments_;
    FragmentGradients<Device, SurfelGradients<true, float>> map_fragments_;
};

}  // namespace tvsgs
