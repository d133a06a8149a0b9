// Base class of the rasterisers with tiles: results, and the second half of the backward pass.
#pragma once

#include <optional>

#include "render/tiles/fused_gradients.h"
#include "render/tiles/view_colors.h"

namespace tvsgs {

template <class Device>
class TiledBackbone : public Backbone<Device> {
public:
    /// Sets the traits of blend_backward() and add_camera_gradient().
    explicit TiledBackbone(BackboneTraits of) : Backbone<Device>(with_gradients(of)) {}

    void backward(const Gaussians<Device>& g,
                  const ImageGradients<Device>& dL_dimages,
                  Gaussians<Device>& dL) final {
        const FusedGradients& fused = *this->blend_backward(g, dL_dimages);
        this->clock()("project backward", [&] {
            fused.visit([&]<class Vjp>(const Vjp& vjp) {
                parallel_for(
                    Device{}, g.size(),
                    AddGradientsBody<Vjp>{vjp, g.means.span(), g.log_scales.span(), g.quats.span(),
                                          g.opacity_logits.span(), g.sh.span(), dL.means.span(),
                                          dL.log_scales.span(), dL.quats.span(),
                                          dL.opacity_logits.span(), dL.sh.span()});
            });
        });
    }

    void observe(const Gaussians<Device>& g) final {
        write_statistics(Device{}, *this->blend_backward(g, {}));
    }

    void add_camera_gradient(const Gaussians<Device>& g,
                             const ImageGradients<Device>& dL_dimages,
                             Span<double> sum) final {
        const FusedGradients& fused = *this->blend_backward(g, dL_dimages);
        this->clock()("camera backward", [&] {
            of_camera_.resize(g.means.size()), partial_.resize(kSumBlocks);
            fused.visit([&]<class Vjp>(const Vjp& vjp) {
                parallel_for(Device{}, g.size(),
                             CameraGradientBody<Vjp>{vjp, images_.camera.camera_from_world.R,
                                                     camera_centre(images_.camera), g.means.span(),
                                                     g.log_scales.span(), g.quats.span(),
                                                     g.opacity_logits.span(), g.sh.span(),
                                                     of_camera_.span()});
            });
            for (int k = 0; k < kCameraParameters; ++k)
                add_sum(Device{}, g.size(), CameraGradientTerm{std::as_const(of_camera_).span(), k},
                        1, partial_.span(), sum.data + k);
        });
    }

    const ScreenStatistics<Device>& statistics() const final { return statistics_; }
    RenderCounts counts() const final { return {lists_.visible_count, lists_.fragment_count}; }

protected:
    static BackboneTraits with_gradients(BackboneTraits of) {
        of.fuses = of.has_camera_gradient = true;
        return of;
    }

    /// First half of forward(): finds the splats in view, their colours if requested, and their
    /// tiles. project() as in PlaceFinder.
    template <class Splats, class Project>
    void list_splats(const Gaussians<Device>& g,
                     const TileGrid& grid,
                     const Project& project,
                     const std::optional<ViewColors>& colors,
                     Splats& splats) {
        auto& clock = this->clock();
        do {
            clock("project",
                  [&] { finder_.find(g.size(), project, statistics_.radii_px, splats); });
            if (colors) clock("colours", [&] { find_colors(g, *colors, splats.features.span()); });
            clock("tile lists", [&] { build_tile_lists(splats, grid, lists_); });
        } while (!finder_.found_room(lists_.in_view));
    }

    SplatPlaces places() const { return finder_.places(statistics_.radii_px); }

    template <class Gradients>
    SplatSums<Gradients> sums(const FragmentGradients<Device, Gradients>& fragments) {
        const std::size_t n = statistics_.radii_px.size();
        statistics_.dL_dmeans2d.resize(n);
        statistics_.abs_dL_dmeans2d.resize(n);
        statistics_.front_pixels.resize(n);
        return {places(),
                std::as_const(lists_.fragment_counts).span(),
                std::as_const(lists_.first_fragment).span(),
                fragments.gradients.span(),
                fragments.drawn.span(),
                statistics_.dL_dmeans2d.span(),
                statistics_.abs_dL_dmeans2d.span(),
                statistics_.front_pixels.span()};
    }

    TileLists<Device> lists_;  // of the last forward(), by place; like the images
    RenderedImages<Device> images_;
    Buffer<std::uint32_t, Device> stops_;  // [H W] see blend_tiles()
    ScreenStatistics<Device> statistics_;
    FusedGradients gradients_;  // of the last blend_backward()

private:
    template <class Record>
    void find_colors(const Gaussians<Device>& g, const ViewColors& view, Span<Record> features) {
        parallel_for(Device{}, g.size(),
                     ColorBody<Record>{view, g.means.span(), g.sh.data(), places(), features});
    }

    PlaceFinder<Device> finder_;
    Buffer<CameraGradient<float>, Device> of_camera_;  // [N] empty if no camera moves
    Buffer<double, Device> partial_;
};

template <class Device>
void write_statistics(Device device, const FusedGradients& gradients) {
    gradients.visit([&]<class Vjp>(const Vjp& vjp) {
        parallel_for(device, vjp.sums.places.radii.size(), ObserveBody<Vjp>{vjp});
    });
}

}  // namespace tvsgs
