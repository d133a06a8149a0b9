// A second view of the same Gaussians, for the terms that compare views.
#pragma once

#include <memory>
#include <string>

#include "core/parallel.h"
#include "core/scan.h"
#include "optim/device_view.h"
#include "optim/multiview_math.h"
#include "optim/neighbours.h"
#include "render/backbone.h"

namespace tvsgs {

/// How far a pixel's surface is seen alike by both views.
struct CompareBody {
    ViewPair<float> pair;
    Camera camera;  // of the reference
    Span<const float> depth, neighbour_depth;
    Span<float> weight;
    Span<int> valid;

    TVSGS_HD void operator()(int at) const {
        const auto r =
            reproject(pair, pixel_ray(camera, at % camera.width_px, at / camera.width_px),
                      depth[at], [&](int i) { return neighbour_depth[i]; });
        valid[at] = r.valid;
        weight[at] = r.valid ? std::exp(-r.distance) : 0;
    }
};

struct CountValid {
    Span<const int> valid;
    TVSGS_HD int operator()(int i) const { return valid[i]; }
};

/// Turns the collected derivatives by log depth into those by depth.
struct ResolveDepthBody {
    Span<const std::int64_t> fixed;
    double unit;
    const double* scale;  // divides
    Span<const float> depth;
    Span<float> dL_ddepth;  // added to

    TVSGS_HD void operator()(int at) const {
        if (fixed[at] == 0) return;
        dL_ddepth[at] += static_cast<float>(static_cast<double>(fixed[at]) * unit / *scale /
                                            static_cast<double>(depth[at]));
    }
};

/// Renders the depth of a neighbour of the current view, compares the two depth maps, and
/// takes the derivatives that losses hand back to it through a backward pass of its own.
template <class Device>
class NeighbourView {
public:
    NeighbourView(Neighbourhood choice,
                  std::unique_ptr<Backbone<Device>> backbone,
                  std::uint64_t seed)
        : choice_(std::move(choice)), backbone_(std::move(backbone)), seed_(seed) {
        valid_count_.resize(1);
        partial_.resize(kSumBlocks);
    }

    /// One of the neighbours of view `reference`, drawn for this step; -1 when there is none.
    int choose(int step, int reference) const {
        const std::vector<int>& choice = choice_.of_view[static_cast<std::size_t>(reference)];
        if (choice.empty()) return -1;
        const float draw =
            uniform(random4(seed_, RandomStream::neighbour, static_cast<std::uint64_t>(step)).v[0]);
        const auto at = static_cast<std::size_t>(draw * static_cast<float>(choice.size()));
        return choice[std::min(at, choice.size() - 1)];
    }

    /// Renders choose(step, reference); returns itself, or null when there is none.
    NeighbourView* render(int step,
                          int reference,
                          const std::vector<DeviceView<Device>>& views,
                          const Gaussians<Device>& gaussians) {
        const int neighbour = choose(step, reference);
        if (neighbour < 0) return nullptr;
        view_ = &views[static_cast<std::size_t>(neighbour)];
        images_ = &backbone_->forward(gaussians, view_->camera, 0, Maps::depth);
        dL_dimages_.depth.resize(0);
        return this;
    }

    /// Fills weight() and valid() for the pixels of the reference.
    void compare(const RenderedImages<Device>& reference) {
        pair_ = view_pair(reference.camera, images_->camera, choice_.min_depth);
        weight_.resize(reference.depth.size()), valid_.resize(reference.depth.size());
        const int pixels = static_cast<int>(reference.depth.size());
        parallel_for(Device{}, pixels,
                     CompareBody{pair_, reference.camera, reference.depth.span(),
                                 images_->depth.span(), weight_.span(), valid_.span()});
        valid_count_.fill_zero();
        add_sum(Device{}, pixels, CountValid{valid_.span()}, 1, partial_.span(),
                valid_count_.data());
    }

    const DeviceView<Device>& view() const { return *view_; }
    const RenderedImages<Device>& images() const { return *images_; }
    const ViewPair<float>& pair() const { return pair_; }  // on the rays of both depth maps
    /// [H W] of the reference: exp(-reprojection distance in px), a constant of the losses that
    /// fades out what the neighbour sees otherwise; 0 where the views cannot be compared.
    Span<const float> weight() const { return weight_.span(); }
    const Buffer<int, Device>& valid() const { return valid_; }        // [H W] 1 or 0
    const double* valid_count() const { return valid_count_.data(); }  // on the device

    /// [H W] of the neighbour, cleared: a term's sums of kFixedUnit x derivatives by the logarithm
    /// of depth, to be resolved before another term asks for room. Several pixels of the reference
    /// fall between the same pixels of the neighbour. Integer atomics add them in any order to the
    /// same bits, which float atomics would not, and a gather would first have to sort the pixels
    /// by where they fall. The derivative by log depth is a distance in pixels, so one unit fits
    /// every scene: it resolves 2^-32 px and has room for 2,000 pixels of 10^6 px each.
    Span<std::int64_t> depth_gradients() {
        const std::size_t pixels = images_->depth.size();
        fixed_.resize(pixels);
        fixed_.fill_zero();
        return fixed_.span();
    }

    /// Adds depth_gradients() x weight / *count to those of the render.
    void resolve_depth_gradients(float weight, const double* count) {
        const std::size_t pixels = images_->depth.size();
        if (dL_dimages_.depth.empty()) {
            dL_dimages_.depth.resize(pixels);
            dL_dimages_.depth.fill_zero();
        }
        parallel_for(Device{}, static_cast<int>(pixels),
                     ResolveDepthBody{fixed_.span(), weight / kFixedUnit, count,
                                      images_->depth.span(), dL_dimages_.depth.span()});
    }

    const ImageGradients<Device>& dL_dimages() const { return dL_dimages_; }

    /// Adds what the losses handed back; nothing when they did not.
    void backward(const Gaussians<Device>& gaussians, Gaussians<Device>& dL_dgaussians) {
        if (!dL_dimages_.depth.empty()) backbone_->backward(gaussians, dL_dimages_, dL_dgaussians);
    }

    static constexpr double kFixedUnit = 4294967296.0;  // 2^32

private:
    Neighbourhood choice_;
    std::unique_ptr<Backbone<Device>> backbone_;
    std::uint64_t seed_;
    const DeviceView<Device>* view_ = nullptr;
    const RenderedImages<Device>* images_ = nullptr;
    ViewPair<float> pair_{};
    Buffer<float, Device> weight_;
    Buffer<int, Device> valid_;
    Buffer<double, Device> valid_count_, partial_;
    Buffer<std::int64_t, Device> fixed_;
    ImageGradients<Device> dL_dimages_;
};

}  // namespace tvsgs
