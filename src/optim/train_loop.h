// The loop itself; included by one file per device.
#pragma once

#include "core/rng.h"
#include "core/stage_clock.h"
#include "optim/device_views.h"
#include "optim/fixed_voters.h"
#include "optim/train.h"
#include "optim/train_state.h"

namespace tvsgs {

/// What the terms that act at a step want, of a view that has a neighbour or has none.
template <class Device>
LossNeeds needs_at(const std::vector<std::unique_ptr<Loss<Device>>>& losses,
                   int step,
                   bool has_neighbour) {
    LossNeeds all;
    for (const auto& term : losses)
        if (const LossNeeds needs = term->needs();
            term->active(step) && (has_neighbour || !needs.neighbour))
            all |= needs;
    all.maps |= Maps::color;
    return all;
}

/// Null when no term compares views: then nothing is chosen, allocated or said.
template <class Device>
std::unique_ptr<NeighbourView<Device>> make_neighbour_view(const Scene& scene,
                                                           const TrainOptions& options,
                                                           bool quiet = false) {
    if (!needs_of(options.loss).neighbour) return nullptr;
    return std::make_unique<NeighbourView<Device>>(
        select_neighbours(scene, options.loss.multi_view, quiet),
        make_backbone<Device>(options.backbone, options.core),
        static_cast<std::uint64_t>(options.seed));
}

/// Sizes and clears what the step adds to; with `all`, also room for the gradients of the render.
template <class Device>
void reset(Objective<Device>& objective,
           const Gaussians<Device>& gaussians,
           bool splat_gradients,
           bool all,
           const RenderedImages<Device>& images) {
    objective.dL_dimages.color.resize(images.color.size());
    objective.dL_dimages.normal.resize(images.normal.size());
    objective.dL_dimages.depth.resize(images.depth.size());
    objective.dL_dimages.color.fill_zero();
    objective.dL_dimages.normal.fill_zero();
    objective.dL_dimages.depth.fill_zero();
    if (all)
        resize(objective.dL_dgaussians, gaussians.size(), gaussians.sh_degree);
    else
        resize_geometry(objective.dL_dgaussians, splat_gradients ? gaussians.size() : 0);
    fill_zero(objective.dL_dgaussians);
    objective.values.fill_zero();
}

/// From the images back to the splats: into the objective, or where the backbone fuses it with
/// Adam's step, half of the way.
template <class Device>
const ViewGradients* propagate_back(Backbone<Device>& backbone,
                                    const Gaussians<Device>& gaussians,
                                    Objective<Device>& objective) {
    if (backbone.fuses()) return backbone.blend_backward(objective.dL_dimages);
    backbone.backward(gaussians, objective.dL_dimages, objective.dL_dgaussians);
    return nullptr;
}

/// Adam's step along what propagate_back() gave.
template <class Device>
void descend(Adam<Device>& adam,
             int step,
             float extent,
             int sh_degree,
             const ViewGradients* fused,
             Objective<Device>& objective,
             Gaussians<Device>& gaussians,
             bool with_opacity,
             const int* halted) {
    if (fused != nullptr)
        adam.step(step, extent, *fused, objective.dL_dgaussians, gaussians, with_opacity, halted);
    else
        adam.step(step, extent, sh_degree, objective.dL_dgaussians, gaussians, with_opacity,
                  halted);
}

template <class Device>
TrainReport make_report(int step,
                        const Objective<Device>& objective,
                        const std::vector<std::unique_ptr<Loss<Device>>>& losses,
                        const Gaussians<Device>& gaussians,
                        const StageClock<Device>& clock) {
    TrainReport report{step, 0, {}, gaussians.size(), memory_use(Device{}), clock.stages()};
    const std::vector<double> values = to_host(objective.values);
    for (std::size_t i = 0; i < losses.size(); ++i) {
        report.terms.emplace_back(losses[i]->name(), values[i]);
        report.loss += values[i];
    }
    return report;
}

template <class Device>
Gaussians<Device> train(const Scene& scene,
                        const TrainOptions& options,
                        const TrainCallbacks& callbacks,
                        const AfterStep<Device>& after_step,
                        const SharedState& start) {
    auto backbone = make_backbone<Device>(options.backbone, options.core);
    auto neighbours = make_neighbour_view<Device>(scene, options, callbacks.goes_on);
    Training<Device> t(scene, options, callbacks, start);
    Objective<Device> objective;
    objective.values.resize(t->losses.size());
    objective.partial.resize(kSumBlocks);
    objective.count.resize(1);
    DeviceViews<Device> views(scene.train, needs_of(options.loss), options.photo_bytes);
    StageClock<Device> clock(callbacks.profile);

    const SplatsNow<Device> splats_now = [&]() -> const Gaussians<Device>& { return t->gaussians; };

    for (int step = t->done + 1; step <= options.iterations; step = t->done + 1) {
        if (callbacks.stop_requested && callbacks.stop_requested()) {
            t.stop();
            break;
        }
        if (callbacks.save_due && callbacks.save_due(step - 1) && !t.save()) continue;
        const int sh_degree = sh_degree_at(options.model, step);
        const DeviceView<Device>& view = views.get(t->sampler.next());
        const bool compare = needs_at(t->losses, step, true).neighbour;
        if (!views.all_resident()) {  // before the device has work, beside which they then come
            const auto fetch_neighbour = [&](int at_step, int reference, bool now) {
                const int n = compare ? neighbours->choose(at_step, reference) : -1;
                if (n >= 0) now ? void(views.get(n)) : views.prefetch(n);
            };
            fetch_neighbour(step, view.index, true);
            ViewSampler ahead = t->sampler;
            const int next = ahead.next();
            views.prefetch(next);
            fetch_neighbour(step + 1, next, false);
        }
        if (t->voter.due(step)) clock("voting", [&] { t.vote(step); });

        NeighbourView<Device>* const neighbour = !compare ? nullptr : clock("neighbour", [&] {
            return neighbours->render(step, view.index, views.views(), t->gaussians);
        });
        const LossNeeds needs = needs_at(t->losses, step, neighbour != nullptr);
        const RenderedImages<Device>& images =
            clock("forward", [&]() -> const RenderedImages<Device>& {
                return backbone->forward(t->gaussians, view.camera, sh_degree, needs.maps);
            });
        clock("losses", [&] {
            reset(objective, t->gaussians, needs.splat_gradients, !backbone->fuses(), images);
            if (neighbour) neighbour->compare(images);
            for (std::size_t i = 0; i < t->losses.size(); ++i)
                if (t->losses[i]->active(step))
                    t->losses[i]->add_to(objective, objective.values.data() + i,
                                         {t->gaussians, images, view, t->field,
                                          backbone->statistics().radii_px.span(), step, neighbour});
            t.watch(step, view.index, objective.values);
        });
        // Where splats come and go, gradients are lost, as in the official codes.
        const bool changes = t->densifier.may_change_structure(step);
        const bool steps = !changes && step < options.iterations;
        const ViewGradients* const fused = clock("backward", [&] {
            if (neighbour && steps) neighbour->backward(t->gaussians, objective.dL_dgaussians);
            return propagate_back(*backbone, t->gaussians, objective);
        });
        const bool report = callbacks.report_due && callbacks.report_due(step);
        // A splat that is pruned could no longer be named.
        const bool look = report || changes || step % kCheckEvery == 0 || !steps;
        if (look && !t.check(step)) continue;
        if (report)
            callbacks.on_report(make_report(step, objective, t->losses, t->gaussians, clock));
        if (steps)
            clock("adam", [&] {
                const bool with_opacity = !(options.optim.skip_step_on_structure_change &&
                                            t->densifier.resets_opacity(step));
                descend(t->adam, step, scene.extent, sh_degree, fused, objective, t->gaussians,
                        with_opacity, t.halted());
            });
        else if (fused != nullptr)
            write_statistics(Device{}, *fused);

        const auto event = clock("densify", [&] {
            return t->densifier.step(
                step, backbone->statistics(), t->gaussians, t->adam, [&](const auto& count_views) {
                    for (const auto& other : views.views()) {
                        backbone->forward(t->gaussians, other.camera, 0, kGeometryMaps);
                        backbone->observe(t->gaussians);
                        count_views(backbone->statistics());
                    }
                });
        });
        if (event.structure_changed) t->voter.structure_changed(t->densifier.parents(), t->field);
        t.step_done(step);
        if (after_step) after_step(step, splats_now);
    }
    splats_now();
    if (callbacks.on_end) callbacks.on_end(t->done);
    return std::move(t->gaussians);
}

}  // namespace tvsgs
