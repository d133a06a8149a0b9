// Renders neighbour views of the current view, for terms that compare views.
#pragma once

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "core/device/parallel.h"
#include "core/device/scan.h"
#include "optim/losses/multiview_math.h"
#include "optim/views/device_view.h"
#include "optim/views/view_pairs.h"
#include "render/backbone.h"

namespace tvsgs {

/// Compares the depth of a pixel in both views; weights pixels by their agreement.
struct CompareBody {
    ViewPair<float> pair;
    Camera camera;  // of the reference
    Span<const float> depth, other_depth;
    Span<float> weight;
    Span<int> valid;

    TVSGS_HD void operator()(int at) const {
        const auto r =
            reproject(pair, pixel_ray(camera, at % camera.width_px, at / camera.width_px),
                      depth[at], [&](int i) { return other_depth[i]; });
        valid[at] = r.valid;
        weight[at] = r.valid ? std::exp(-r.distance) : 0;
    }
};

struct CountValid {
    Span<const int> valid;
    TVSGS_HD int operator()(int i) const { return valid[i]; }
};

/// Converts the collected derivatives by log depth into derivatives by depth.
struct ResolveDepthBody {
    Span<const std::int64_t> fixed;
    double unit;
    const double* scale;  // divisor
    Span<const float> depth;
    Span<float> dL_ddepth;  // added to

    TVSGS_HD void operator()(int at) const {
        if (fixed[at] == 0) return;
        dL_ddepth[at] += float(double(fixed[at]) * unit / *scale / double(depth[at]));
    }
};

/// A neighbour view. If it is rendered, losses may pass derivatives to its depth map.
template <class Device>
class NeighbourView {
public:
    /// Without a backbone the view is not rendered.
    explicit NeighbourView(std::unique_ptr<Backbone<Device>> backbone)
        : backbone_(std::move(backbone)) {
        valid_count_.resize(1);
        partial_.resize(kSumBlocks);
    }

    void begin(const DeviceView<Device>& view, const Gaussians<Device>& gaussians) {
        view_ = &view;
        if (!rendered()) return;
        images_ = &backbone_->forward(gaussians, view.camera, 0, Maps::depth);
        dL_dimages_.depth.resize(0);
    }

    /// Fills weight() and valid() for the pixels of the reference view, if this view is rendered.
    void compare(const RenderedImages<Device>& reference, float min_depth) {
        if (!rendered()) {
            pair_ = view_pair(reference.camera, view_->camera, min_depth);
            return;
        }
        pair_ = view_pair(reference.camera, images_->camera, min_depth);
        weight_.resize(reference.depth.size()), valid_.resize(reference.depth.size());
        const int pixels = int(reference.depth.size());
        parallel_for(Device{}, pixels,
                     CompareBody{pair_, reference.camera, reference.depth.span(),
                                 images_->depth.span(), weight_.span(), valid_.span()});
        valid_count_.fill_zero();
        add_sum(Device{}, pixels, CountValid{valid_.span()}, 1, partial_.span(),
                valid_count_.data());
    }

    const DeviceView<Device>& view() const { return *view_; }
    bool rendered() const { return backbone_ != nullptr; }
    const ViewPair<float>& pair() const { return pair_; }  // for the rays of both depth maps

    // Only for a rendered view:
    const RenderedImages<Device>& images() const { return *images_; }
    /// [H W] of the reference: exp(-reprojection distance in px), a constant of the losses; 0 where
    /// the views cannot be compared.
    Span<const float> weight() const { return weight_.span(); }
    const Buffer<int, Device>& valid() const { return valid_; }        // [H W] 1 or 0
    const double* valid_count() const { return valid_count_.data(); }  // on the device

    /// [H W] of this view, cleared by this call. A term adds kFixedUnit times its derivatives by
    /// the logarithm of this view's depth, and has to call resolve_depth_gradients() before another
    /// term calls this. They are added atomically, as integers, whose sum has the same bits in any
    /// order. The derivative by log depth is a distance in pixels: the unit resolves 2^-32 px and
    /// holds 2,000 pixels of 10^6 px each.
    Span<std::int64_t> depth_gradients() {
        const std::size_t pixels = images_->depth.size();
        fixed_.resize(pixels);
        fixed_.fill_zero();
        return fixed_.span();
    }

    /// Adds depth_gradients() x weight / *count to the depth gradients of this render.
    void resolve_depth_gradients(float weight, const double* count) {
        const std::size_t pixels = images_->depth.size();
        if (dL_dimages_.depth.empty()) {
            dL_dimages_.depth.resize(pixels);
            dL_dimages_.depth.fill_zero();
        }
        parallel_for(Device{}, int(pixels),
                     ResolveDepthBody{fixed_.span(), weight / kFixedUnit, count,
                                      images_->depth.span(), dL_dimages_.depth.span()});
    }

    const ImageGradients<Device>& dL_dimages() const { return dL_dimages_; }

    /// Adds the gradients of all resolved derivatives; does nothing without any.
    void backward(const Gaussians<Device>& gaussians, Gaussians<Device>& dL_dgaussians) {
        if (!dL_dimages_.depth.empty()) backbone_->backward(gaussians, dL_dimages_, dL_dgaussians);
    }

    static constexpr double kFixedUnit = 4294967296.0;  // 2^32

private:
    std::unique_ptr<Backbone<Device>> backbone_;
    const DeviceView<Device>* view_ = nullptr;
    const RenderedImages<Device>* images_ = nullptr;
    ViewPair<float> pair_{};
    Buffer<float, Device> weight_;
    Buffer<int, Device> valid_;
    Buffer<double, Device> valid_count_, partial_;
    Buffer<std::int64_t, Device> fixed_;
    ImageGradients<Device> dL_dimages_;
};

/// The neighbour views of one step, drawn from the pairs of its view; the first are rendered.
template <class Device>
class NeighbourViews {
public:
    static constexpr int kMost = 4;  // per step: one draw of the generator has four numbers

    /// Makes one neighbour view per entry of `backbones`, at most kMost; null: it is not rendered.
    NeighbourViews(ViewPairs pairs,
                   std::vector<std::unique_ptr<Backbone<Device>>> backbones,
                   std::uint64_t seed)
        : pairs_(std::move(pairs)), seed_(seed) {
        for (auto& backbone : backbones) others_.emplace_back(std::move(backbone));
    }

    /// Neighbour views of `reference` at iteration `step`, all different, as far as it has pairs.
    std::vector<int> choose(int step, int reference) const {
        std::vector<int> left = pairs_.of_view[reference], chosen;
        const Random4 draws = random4(seed_, RandomStream::neighbour_views, std::uint64_t(step));
        for (std::size_t i = 0; i < others_.size() && !left.empty(); ++i) {
            const float draw = uniform(draws.v[i]);
            const auto at = std::min(std::size_t(draw * float(left.size())), left.size() - 1);
            chosen.push_back(left[at]);
            left.erase(left.begin() + std::ptrdiff_t(at));
        }
        return chosen;
    }

    /// Renders the views that choose() returns.
    void begin(int step,
               int reference,
               const std::vector<DeviceView<Device>>& views,
               const Gaussians<Device>& gaussians) {
        count_ = 0;
        for (const int chosen : choose(step, reference))
            others_[count_++].begin(views[chosen], gaussians);
    }

    void compare(const RenderedImages<Device>& reference) {
        for (int i = 0; i < count_; ++i) (*this)[i].compare(reference, pairs_.min_depth);
    }

    void backward(const Gaussians<Device>& gaussians, Gaussians<Device>& dL_dgaussians) {
        for (int i = 0; i < count_; ++i) (*this)[i].backward(gaussians, dL_dgaussians);
    }

    int count() const { return count_; }  // of the current step
    NeighbourView<Device>& operator[](int i) { return others_[i]; }

private:
    ViewPairs pairs_;
    std::uint64_t seed_;
    std::vector<NeighbourView<Device>> others_;
    int count_ = 0;
};

}  // namespace tvsgs
