// One iteration, from a view to gradients and a step: what training and its benchmark share.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/stage_clock.h"
#include "optim/adam.h"
#include "optim/device_views.h"
#include "optim/fixed_splats.h"
#include "optim/train.h"

namespace tvsgs {

/// What the terms that act at a step want of view `view`, which has other views to look at or has
/// none.
template <class Device>
LossNeeds needs_at(const std::vector<std::unique_ptr<Loss<Device>>>& losses,
                   int step,
                   int view,
                   bool has_others) {
    LossNeeds all;
    for (const auto& term : losses)
        if (const LossNeeds needs = term->needs_at(step, view);
            term->active(step) && (has_others || needs.other_views == 0))
            all |= needs;
    all.maps |= Maps::color;
    return all;
}

/// Null when no term looks at other views: then no pairs are chosen, allocated or said.
template <class Device>
std::unique_ptr<OtherViews<Device>> make_other_views(const Scene& scene,
                                                     const TrainOptions& options,
                                                     bool quiet) {
    const LossNeeds needs = needs_of(options.loss);
    if (needs.other_views == 0) return nullptr;
    std::vector<std::unique_ptr<Backbone<Device>>> backbones(
        static_cast<std::size_t>(needs.other_views));
    for (int i = 0; i < needs.rendered_views; ++i)
        backbones[static_cast<std::size_t>(i)] =
            make_backbone<Device>(options.backbone, options.render);
    return std::make_unique<OtherViews<Device>>(
        select_view_pairs(scene, options.loss.multi_view, quiet), std::move(backbones),
        static_cast<std::uint64_t>(options.seed));
}

template <class Device>
class Iteration {
public:
    using Losses = std::vector<std::unique_ptr<Loss<Device>>>;

    /// The scene has to outlive this. `quiet`: says nothing of pairs of views.
    Iteration(const Scene& scene, const TrainOptions& options, bool quiet)
        : batched_(options.comm.batch > 1),
          backbone_(make_backbone<Device>(options.backbone, options.render)),
          others_(make_other_views<Device>(scene, options, quiet)),
          views_(scene.train, needs_of(options.loss), options.photo_bytes),
          model_(options.model),
          bounds_(options.bounds),
          extent_(scene.extent),
          fixed_(scene.fixed_splats, options.model.sh_degree) {
        check_cameras(options, backbone_->moves_cameras());
        check_harmonics(scene, options, backbone_->fuses());
        for (const TermOnList& term : terms_on_list(options.loss))
            if (term.weight > 0) loss_stages_.push_back(term.key + " loss");
        for (const View& view : scene.train) cameras_.push_back(view.camera);
        copy_bound_cameras();
        objective_.values.resize(loss_stages_.size());
        objective_.partial.resize(kSumBlocks);
        objective_.count.resize(1);
    }

    /// The view with its photograph, for iteration `number`. `next()`: number and view of the one
    /// after it, whose photographs then come while the device works; asked only where they are not
    /// all there.
    template <class Next>
    const DeviceView<Device>& fetch(int number, int view, const Losses& losses, const Next& next) {
        const DeviceView<Device>& here = views_.get(view);
        if (views_.all_resident()) return here;
        const bool looks_around = needs_at(losses, number, view, true).other_views > 0;
        if (looks_around)
            for (const int other : others_->choose(number, view)) views_.get(other);
        const auto [next_number, after] = next();
        views_.prefetch(after);
        if (looks_around)
            for (const int other : others_->choose(next_number, after)) views_.prefetch(other);
        return here;
    }

    /// Before its photographs, also where a process has none.
    void begin_step(int step) { sh_degree_ = sh_degree_at(model_, step); }

    /// Iteration `number` of the step that ends with iteration `step`: renders the view, adds up
    /// the losses, and goes back to the splats: into the gradients, or half of the way where the
    /// backbone fuses the rest with Adam's step. `watch(values)` is given the losses. Terms learn
    /// at once, unless the step looks at several photographs. Without `for_step` only the
    /// statistics of the screen are asked for. What moves cameras adds its derivatives by this one
    /// to `by_camera`, unless that is empty.
    template <class Watch>
    void propagate(int number,
                   int step,
                   const DeviceView<Device>& view,
                   const Gaussians<Device>& gaussians,
                   const Losses& losses,
                   const TensorField<Device>& field,
                   bool for_step,
                   Span<double> by_camera,
                   const Watch& watch) {
        begin_step(step);
        const Gaussians<Device>& drawn = fixed_.join(gaussians);
        OtherViews<Device>* others = nullptr;
        if (needs_at(losses, number, view.index, true).other_views > 0)
            clock("other views", [&] {
                details("other views, forward", [&] {
                    others_->begin(number, view.index, views_.views(), drawn);
                    if (others_->count() > 0) others = others_.get();
                });
            });
        const LossNeeds needs = needs_at(losses, number, view.index, others != nullptr);
        const auto& images = clock("forward", [&]() -> const RenderedImages<Device>& {
            return backbone_->forward(drawn, view.camera, sh_degree_, needs.maps);
        });
        clock("losses", [&] {
            details("clear gradients", [&] { clear(gaussians, needs, images); });
            if (others) details("compare views", [&] { others->compare(images); });
            for (std::size_t i = 0; i < losses.size(); ++i) {
                if (!losses[i]->active(number)) continue;
                details(loss_stages_[i].c_str(), [&] {
                    losses[i]->add_to(objective_, objective_.values.data() + i,
                                      {gaussians, images, view, field,
                                       backbone_->statistics().radii_px.span(), number, others});
                    if (const auto* const lesson = losses[i]->lesson(); lesson && !batched_)
                        losses[i]->learn(number, view.index, lesson->data());
                });
                if (!by_camera.empty() && losses[i]->moves_cameras())
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

    /// Adam's step along what propagate() gave, or along the mean over `photographs` of their
    /// `sum`.
    void descend(int step,
                 Adam<Device>& adam,
                 Gaussians<Device>& gaussians,
                 bool with_opacity,
                 const int* halted,
                 Gaussians<Device>* sum = nullptr,
                 int photographs = 1) {
        Gaussians<Device>& gradients = sum == nullptr ? objective_.dL_dgaussians : *sum;
        clock("adam", [&] {
            details("project backward and Adam", [&] {
                if (fused_ != nullptr)
                    adam.step(step, extent_, sh_degree_, *fused_, gradients, gaussians,
                              with_opacity, halted);
                else
                    adam.step(step, extent_, sh_degree_, gradients, gaussians, with_opacity, halted,
                              1 / static_cast<float>(photographs));
            });
        });
        if (bounds_.on())
            parallel_for(Device{}, gaussians.size(),
                         BoundBody{std::as_const(bound_cameras_).span(), bounds_,
                                   std::as_const(gaussians.means).span(),
                                   gaussians.log_scales.span(), halted});
    }

    /// In the place of descend(): the statistics that its second half of the way would write.
    void finish_statistics() {
        if (fused_ != nullptr) write_statistics(Device{}, *fused_);
    }

    /// From the next step on the training views are where these are.
    void set_cameras(const std::vector<Camera>& cameras) {
        cameras_ = cameras;
        views_.set_cameras(cameras);
        copy_bound_cameras();
    }

    /// Before the first step, and after each of iterations [first, step]; see Backbone::prepare().
    void prepare(int first, int step, bool changed, Gaussians<Device>& gaussians) {
        for (int number = first; number <= step; ++number)
            backbone_->prepare(number, changed && number == step, cameras_, gaussians);
    }

    /// visit(statistics) of what each training view sees of the splats, fixed ones last: of every
    /// `ranks`-th view from `rank` on.
    template <class Visit>
    void observe(const Gaussians<Device>& gaussians, int rank, int ranks, const Visit& visit) {
        const Gaussians<Device>& drawn = fixed_.join(gaussians);
        for (const auto& view : views_.views()) {
            if (view.index % ranks != rank) continue;
            backbone_->forward(drawn, view.camera, 0, kGeometryMaps);
            backbone_->observe(drawn);
            visit(backbone_->statistics());
        }
    }

    Backbone<Device>& backbone() { return *backbone_; }
    OtherViews<Device>* others() { return others_.get(); }  // null: no term looks at any
    const Objective<Device>& objective() const { return objective_; }

    // Of a step of several photographs: what propagate() gave of one of them.
    Gaussians<Device>& gradients() { return objective_.dL_dgaussians; }
    Buffer<double, Device>& values() { return objective_.values; }
    int sh_degree() const { return sh_degree_; }
    /// gradients() have been taken from there, and left as zeros.
    void gradients_are_taken() { taken_ = true; }

    // Times, unless switched on not taken: the parts of a training, and the parts of these.
    StageClock<Device> clock, details;

private:
    /// Gradients that are in no memory cannot be added up, nor parted from those of fixed splats.
    bool fuses() const { return !batched_ && fixed_.none() && backbone_->fuses(); }

    void copy_bound_cameras() {
        if (bounds_.on()) copy(cameras_, bound_cameras_);
    }

    /// Of the first term: what it has written so far, without the maps that others write to.
    void find_camera_gradient(const Gaussians<Device>& gaussians, Span<double> by_camera) {
        const auto exchange = [&] {
            of_photo_.color.swap(objective_.dL_dimages.color);
            of_photo_.transmittance.swap(objective_.dL_dimages.transmittance);
        };
        exchange();
        backbone_->add_camera_gradient(gaussians, of_photo_, by_camera);
        exchange();
    }

    /// Sizes and clears what the terms add to.
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
            taken_ = false, resize(by_splat, gaussians.size(), gaussians.sh_degree);
        if (!std::exchange(taken_, false)) fill_zero(by_splat);
        objective_.values.fill_zero();
    }

    bool batched_;
    std::unique_ptr<Backbone<Device>> backbone_;
    std::unique_ptr<OtherViews<Device>> others_;
    DeviceViews<Device> views_;
    std::vector<Camera> cameras_;  // of the training views
    ModelOptions model_;
    BoundOptions bounds_;
    Buffer<Camera, Device> bound_cameras_;  // none where there are no bounds
    float extent_;
    FixedSplats<Device> fixed_;
    Objective<Device> objective_;
    ImageGradients<Device> of_photo_;  // empty but while find_camera_gradient() runs
    std::vector<std::string> loss_stages_;
    int sh_degree_ = 0;   // of the step under way
    bool taken_ = false;  // gradients() are zeros
    /// Of the last propagate(); null: the gradients are in the objective.
    const FusedGradients* fused_ = nullptr;
};

}  // namespace tvsgs
