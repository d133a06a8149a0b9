// What rasterisers share that go through tiles and fuse: results, and the second half of the way
// back.
#pragma once

#include "render/fused_gradients.h"

namespace tvsgs {

template <class Device>
class TiledBackbone : public Backbone<Device> {
public:
    bool fuses() const final { return true; }

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

    const ScreenStatistics<Device>& statistics() const final { return statistics_; }
    RenderCounts counts() const final { return {lists_.visible_count, lists_.fragment_count}; }

protected:
    template <class Gradients>
    SplatSums<Gradients> sums(const FragmentGradients<Device, Gradients>& fragments) {
        const std::size_t n = lists_.fragment_counts.size();
        statistics_.dL_dmeans2d.resize(n);
        statistics_.abs_dL_dmeans2d.resize(n);
        statistics_.front_pixels.resize(n);
        return {std::as_const(lists_.fragment_counts).span(),
                std::as_const(lists_.first_fragment).span(),
                fragments.gradients.span(),
                fragments.drawn.span(),
                statistics_.dL_dmeans2d.span(),
                statistics_.abs_dL_dmeans2d.span(),
                statistics_.front_pixels.span()};
    }

    TileLists<Device> lists_;  // of the last forward(), as the images
    RenderedImages<Device> images_;
    Buffer<std::uint32_t, Device> stops_;  // [H W] see blend_tiles()
    ScreenStatistics<Device> statistics_;
    FusedGradients gradients_;  // of the last blend_backward()
};

template <class Device>
void write_statistics(Device device, const FusedGradients& gradients) {
    gradients.visit([&]<class Vjp>(const Vjp& vjp) {
        parallel_for(device, vjp.sums.fragment_counts.size(), ObserveBody<Vjp>{vjp});
    });
}

}  // namespace tvsgs
