// One training iteration: renders a view, computes losses and gradients, and takes Adam's step.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/stage_clock.h"
#include "optim/growth/fixed_splats.h"
#include "optim/loop/train.h"
#include "optim/optimiser/adam.h"
#include "optim/views/device_views.h"

namespace tvsgs {

/// Union of the needs of the terms that act at `step` on `view`, which may have neighbour views.
template <class Device>
LossNeeds needs_at(const std::vector<std::unique_ptr<Loss<Device>>>& losses,
                   int step,
                   int view,
                   bool has_others) {
    LossNeeds all;
    for (const auto& term : losses)
        if (const LossNeeds needs = term->needs_at(step, view);
            term->active(step) && (has_others || needs.neighbour_views == 0))
            all |= needs;
    all.maps |= Maps::color;
    return all;
}

/// Returns null when no term uses neighbour views; then view pairs are neither selected nor logged.
template <class Device>
std::unique_ptr<NeighbourViews<Device>> make_neighbour_views(const Scene& scene,
                                                             const TrainOptions& options,
                                                             bool quiet) {
    const LossNeeds needs = needs_of(options.loss);
    if (needs.neighbour_views == 0) return nullptr;
    std::vector<std::unique_ptr<Backbone<Device>>> backbones(std::size_t(needs.neighbour_views));
    for (int i = 0; i < needs.rendered_views; ++i)
        backbones[i] = make_backbone<Device>(options.backbone, options.render);
    return std::make_unique<NeighbourViews<Device>>(
        select_view_pairs(scene, options.loss.multi_view, quiet), std::move(backbones),
        std::uint64_t(options.seed));
}

template <class Device>
class Iteration {
public:
    using Losses = std::vector<std::unique_ptr<Loss<Device>>>;

    /// `scene` has to outlive this object. `quiet`: does not log view pairs.
    Iteration(const Scene& scene, const TrainOptions& options, bool quiet)
        : backbone_(make_backbone<Device>(options.backbone, options.render)),
          others_(make_neighbour_views<Device>(scene, options, quiet)),
          views_(scene.train, needs_of(options.loss), options.photo_bytes),
          model_(options.model),
          photometric_(options.loss.photometric),
          extent_(scene.extent),
          fixed_(scene.fixed_splats, options.model.sh_degree) {
        check_cameras(options, backbone_->traits.has_camera_gradient);
        check_support(options, backbone_->traits);
        for (const TermOnList& term : terms_on_list(options.loss))
            if (term.weight > 0) loss_stages_.push_back(term.key + " loss");
        for (const View& view : scene.train) cameras_.push_back(view.camera);
        objective_.values.resize(loss_stages_.size());
        objective_.partial.resize(kSumBlocks);
        objective_.count.resize(1);
    }

    /// Returns the view of iteration `step` with its photograph on the device. The photographs of
    /// `next_view()`, the view of the next iteration, are copied while the device works.
    template <class NextView>
    const DeviceView<Device>& fetch(int step,
                                    int view,
                                    const Losses& losses,
                                    const NextView& next_view) {
        const DeviceView<Device>& here = views_.get(view);
        if (views_.all_resident()) return here;
        const bool uses_neighbours = needs_at(losses, step, view, true).neighbour_views > 0;
        if (uses_neighbours)
            for (const int other : others_->choose(step, view)) views_.get(other);
        const int next = next_view();
        views_.prefetch(next);
        if (uses_neighbours)
            for (const int other : others_->choose(step + 1, next)) views_.prefetch(other);
        return here;
    }

    /// Renders the view, sums the losses, passes them to `watch`, and propagates backward to
    /// gradients in memory, or to sums over pixels where the backbone fuses the rest with Adam's
    /// step. Without `for_step` computes only the screen statistics. `by_camera`: derivatives by
    /// this camera are added; empty: none are.
    template <class Watch>
    void propagate(int step,
                   const DeviceView<Device>& view,
                   const Gaussians<Device>& gaussians,
                   const Losses& losses,
                   const TensorField<Device>& field,
                   bool for_step,
                   Span<double> by_camera,
                   const Watch& watch) {
        sh_degree_ = sh_degree_at(model_, step);
        backbone_->set_color_share(photometric_.geometry_at(step));
        const Gaussians<Device>& drawn = fixed_.join(gaussians);
        NeighbourViews<Device>* others = nullptr;
        if (needs_at(losses, step, view.index, true).neighbour_views > 0)
            clock("other views", [&] {
                details("other views, forward", [&] {
                    others_->begin(step, view.index, views_.views(), drawn);
                    if (others_->count() > 0) others = others_.get();
                });
            });
        const LossNeeds needs = needs_at(losses, step, view.index, others != nullptr);
        const auto& images = clock("forward", [&]() -> const RenderedImages<Device>& {
            return backbone_->forward(drawn, view.camera, sh_degree_, needs.maps);
        });
        clock("losses", [&] {
            details("clear gradients", [&] { clear(gaussians, needs, images); });
            if (others) details("compare views", [&] { others->compare(images); });
            for (std::size_t i = 0; i < losses.size(); ++i) {
                if (!losses[i]->active(step)) continue;
                details(loss_stages_[i].c_str(), [&] {
                    objective_.term = int(i);
                    losses[i]->add_to(objective_,
                                      {gaussians, images, view, field,
                                       backbone_->statistics().radii_px.span(), step, others});
                });
                if (!by_camera.empty() && losses[i]->has_camera_gradient())
                    details("camera gradient", [&] { find_camera_gradient(drawn, by_camera); });
            }
            details("watch losses", [&] { watch(objective_.values); });
        });
        clock("backward", [&] {
            Gaussians<Device>& dL_ddrawn =
                fixed_.none() ? objective_.dL_dgaussians : fixed_.clear_gradients();
            if (others && for_step)
                details("other views, backward", [&] { others->backward(drawn, dL_ddrawn); });
            fused_ = nullptr;
            if (fuses())
                fused_ = backbone_->blend_backward(drawn, objective_.dL_dimages);
            else
                backbone_->backward(drawn, objective_.dL_dimages, dL_ddrawn);
            if (!fixed_.none()) fixed_.add_trained_part(objective_.dL_dgaussians);
        });
    }

    /// Takes Adam's step along the gradients of the last propagate().
    void descend(int step,
                 Adam<Device>& adam,
                 Gaussians<Device>& gaussians,
                 bool with_opacity,
                 const int* halted) {
        Gaussians<Device>& gradients = objective_.dL_dgaussians;
        clock("adam", [&] {
            details("project backward and Adam", [&] {
                if (fused_ != nullptr)
                    adam.step(step, extent_, sh_degree_, *fused_, gradients, gaussians,
                              with_opacity, halted);
                else
                    adam.step(step, extent_, sh_degree_, gradients, gaussians, with_opacity,
                              halted);
            });
        });
    }

    /// Called instead of descend(): writes the screen statistics.
    void finish_statistics() {
        if (fused_ != nullptr) write_statistics(Device{}, *fused_);
    }

    /// Sets the cameras of the training views from the next step on.
    void set_cameras(const std::vector<Camera>& cameras) {
        cameras_ = cameras;
        views_.set_cameras(cameras);
    }

    /// Called before the first step (`step` = 0) and after each step; see Backbone::prepare().
    void prepare(int step, bool changed, Gaussians<Device>& gaussians) {
        backbone_->prepare(step, changed, cameras_, gaussians);
    }

    /// Calls visit(statistics) for each training view; the entries of fixed splats come last.
    template <class Visit>
    void observe(const Gaussians<Device>& gaussians, const Visit& visit) {
        const Gaussians<Device>& drawn = fixed_.join(gaussians);
        for (const auto& view : views_.views()) {
            backbone_->forward(drawn, view.camera, 0, kGeometryMaps);
            backbone_->observe(drawn);
            visit(backbone_->statistics());
        }
    }

    Backbone<Device>& backbone() { return *backbone_; }
    /// Null: no term uses neighbour views.
    NeighbourViews<Device>* others() { return others_.get(); }
    const Objective<Device>& objective() const { return objective_; }

    // Stage times, measured only when switched on: stages of a training, and their parts.
    StageClock<Device> clock, details;

private:
    /// Fixed splats need gradients in memory, to separate them from those of trained splats.
    bool fuses() const { return fixed_.none() && backbone_->traits.fuses; }

    /// Derivatives of the first term: reads what it has written so far, before other terms write.
    void find_camera_gradient(const Gaussians<Device>& gaussians, Span<double> by_camera) {
        const auto exchange = [&] {
            photo_gradients_.color.swap(objective_.dL_dimages.color);
            photo_gradients_.transmittance.swap(objective_.dL_dimages.transmittance);
        };
        exchange();
        backbone_->add_camera_gradient(gaussians, photo_gradients_, by_camera);
        exchange();
    }

    /// Sizes and clears the buffers that the terms add to.
    void clear(const Gaussians<Device>& gaussians,
               const LossNeeds& needs,
               const RenderedImages<Device>& images) {
        ImageGradients<Device>& by_image = objective_.dL_dimages;
        const auto clear_like = [](const auto& image, auto& gradient) {
            gradient.resize(image.size());
            gradient.fill_zero();
        };
        clear_like(images.color, by_image.color);
        clear_like(images.normal, by_image.normal);
        clear_like(images.depth, by_image.depth);
        clear_like(images.distortion, by_image.distortion);
        clear_like(images.expected_depth, by_image.expected_depth);
        if (has(needs.maps, Maps::coverage))
            clear_like(images.transmittance, by_image.transmittance);
        Gaussians<Device>& by_splat = objective_.dL_dgaussians;
        if (fuses())
            resize_geometry(by_splat, needs.splat_gradients ? gaussians.size() : 0);
        else if (by_splat.size() != gaussians.size() || by_splat.sh_degree != gaussians.sh_degree)
            resize(by_splat, gaussians.size(), gaussians.sh_degree);
        fill_zero(by_splat);
        objective_.values.fill_zero();
    }

    std::unique_ptr<Backbone<Device>> backbone_;
    std::unique_ptr<NeighbourViews<Device>> others_;
    DeviceViews<Device> views_;
    std::vector<Camera> cameras_;
    ModelOptions model_;
    PhotometricOptions photometric_;
    float extent_;
    FixedSplats<Device> fixed_;
    Objective<Device> objective_;
    ImageGradients<Device> photo_gradients_;  // empty except inside find_camera_gradient()
    std::vector<std::string> loss_stages_;
    int sh_degree_ = 0;  // of the current step
    /// Result of the last propagate(); null: the gradients are in `objective_`.
    const FusedGradients* fused_ = nullptr;
};

}  // namespace tvsgs
