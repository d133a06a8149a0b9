// Base class of the rasterisers with tiles: view and lists of the last render, results, and the
// second half of the backward pass.
#pragma once

#include "render/tiles/fused_gradients.h"

namespace tvsgs {

/// Writes the colours of the splats in view. A separate pass after projection; renders without
/// colour skip it.
template <class Record>
struct ColorBody {
    Vec3f centre;  // of the camera, world
    int sh_degree;
    Span<const Vec3f> means;
    const Vec3f* sh;  // coefficient major
    SplatPlaces places;
    Span<Record> features;

    TVSGS_HD void operator()(int i) const {
        const std::uint32_t at = places.of(i);
        if (at >= features.count) return;
        const Vec3f direction = normalize(means[i] - centre);
        features[at].f.color =
            sh_color<float>(sh_degree, direction, sh, means.count, std::size_t(i));
    }
};

template <class Device>
class TiledBackbone : public Backbone<Device> {
public:
    /// Sets the traits of blend_backward() and add_camera_gradient().
    TiledBackbone(BackboneTraits of, const BackboneOptions& options)
        : Backbone<Device>(with_gradients(of)), options_(options) {}

    void backward(const Gaussians<Device>& g,
                  const ImageGradients<Device>& dL_dimages,
                  Gaussians<Device>& dL) final {
        const FusedGradients& fused = *this->blend_backward(g, dL_dimages);
        this->clock()("project backward", [&] {
            fused.visit([&]<class Vjp>(const Vjp& vjp) {
                parallel_for(
                    Device{}, g.size(),
                    AddGradientsBody<Vjp>{vjp, parameters_of(g), g.sh.span(), dL.means.span(),
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
                parallel_for(
                    Device{}, g.size(),
                    CameraGradientBody<Vjp>{vjp, images_.camera.camera_from_world.R,
                                            camera_centre(images_.camera), parameters_of(g),
                                            g.sh.span(), of_camera_.span()});
            });
            for (int k = 0; k < kCameraParameters; ++k)
                add_sum(Device{}, g.size(), CameraGradientTerm{of_camera_.span(), k}, 1,
                        partial_.span(), sum.data + k);
        });
    }

    const ScreenStatistics<Device>& statistics() const final { return statistics_; }
    RenderCounts counts() const final { return {lists_.visible_count, lists_.fragment_count}; }

protected:
    /// First step of forward(): sets the view and resizes the images, normal and depth only with
    /// plane channels.
    void begin(const Gaussians<Device>& g,
               const Camera& camera,
               int sh_degree,
               Channels channels,
               float low_pass = 0) {
        channels_ = channels;
        view_ = {pinhole<float>(camera),
                 camera_centre(camera),
                 tile_grid(camera.width_px, camera.height_px),
                 sh_degree < g.sh_degree ? sh_degree : g.sh_degree,
                 options_.near,
                 low_pass};
        share_ = {g.uncertainty.span(), this->color_share_};
        const std::size_t pixels = std::size_t(camera.width_px) * std::size_t(camera.height_px);
        images_.width = camera.width_px, images_.height = camera.height_px;
        images_.camera = ray_camera(camera, options_.pixel_center);
        images_.color.resize(has_color(channels) ? pixels : 0);
        images_.transmittance.resize(pixels), stops_.resize(pixels);
        images_.normal.resize(plane_pixels()), images_.depth.resize(plane_pixels());
    }
    /// Number of pixels with maps other than colour and transmittance.
    std::size_t plane_pixels() const {
        return has_plane(channels_) ? images_.transmittance.size() : 0;
    }
    bool median() const { return options_.depth != SurfaceDepth::expected; }
    bool parts_colors() const { return has_color(channels_) && share_.parts(); }

    /// Second step: finds the splats in view, their colours if requested, and their tiles.
    /// project() as in PlaceFinder.
    template <class Splats, class Project>
    void list_splats(const Gaussians<Device>& g, const Project& project, Splats& splats) {
        auto& clock = this->clock();
        do {
            clock("project",
                  [&] { finder_.find(g.size(), project, statistics_.radii_px, splats); });
            if (has_color(channels_))
                clock("colours", [&] { find_colors(g, splats.features.span()); });
            clock("tile lists", [&] { build_tile_lists(splats, view_.grid, lists_); });
        } while (!finder_.found_room(lists_.in_view));
    }

    template <class Gradients>
    SplatSums<Gradients> sums(const FragmentGradients<Device, Gradients>& fragments) {
        const std::size_t n = statistics_.radii_px.size();
        statistics_.dL_dmeans2d.resize(n);
        statistics_.abs_dL_dmeans2d.resize(n);
        statistics_.front_pixels.resize(n);
        return {finder_.places(statistics_.radii_px),
                lists_.fragment_counts.span(),
                lists_.first_fragment.span(),
                fragments.gradients.span(),
                fragments.drawn.span(),
                statistics_.dL_dmeans2d.span(),
                statistics_.abs_dL_dmeans2d.span(),
                statistics_.front_pixels.span()};
    }

    // Of the last forward().
    Channels channels_ = Channels::color;
    ViewParameters view_{};
    ColorShare share_{};
    TileLists<Device> lists_;  // by place
    RenderedImages<Device> images_;
    Buffer<std::uint32_t, Device> stops_;  // [H W] see blend_tiles()
    FusedGradients gradients_;             // of the last blend_backward()

    const BackboneOptions options_;

private:
    static BackboneTraits with_gradients(BackboneTraits of) {
        of.fuses = of.has_camera_gradient = true;
        return of;
    }

    template <class Record>
    void find_colors(const Gaussians<Device>& g, Span<Record> features) {
        parallel_for(Device{}, g.size(),
                     ColorBody<Record>{view_.centre, view_.sh_degree, g.means.span(), g.sh.data(),
                                       finder_.places(statistics_.radii_px), features});
    }

    ScreenStatistics<Device> statistics_;
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
