// The training loop; included by one file per device.
#pragma once

#include "optim/loop/dropout.h"
#include "optim/loop/longest_axis.h"
#include "optim/loop/train_state.h"

namespace tvsgs {

template <class Device>
TrainReport make_report(int step,
                        const Iteration<Device>& iteration,
                        const TrainState<Device>& state) {
    TrainReport report{
        step, 0, {}, state.gaussians.size(), memory_use(Device{}), iteration.clock.stages()};
    const std::vector<double> values = to_host(iteration.objective().values);
    for (std::size_t i = 0; i < values.size(); ++i) {
        report.terms.emplace_back(state.losses[i]->key, values[i]);
        report.loss += values[i];
    }
    return report;
}

template <class Device>
Gaussians<Device> train(const Scene& scene,
                        const TrainOptions& options,
                        const TrainCallbacks& callbacks,
                        const AfterStep<Device>& after_step,
                        SharedState start) {
    Iteration<Device> iteration(scene, options, callbacks.goes_on);
    iteration.clock = StageClock<Device>(callbacks.profile);
    GuardedTraining<Device> training(scene, options, callbacks, std::move(start));
    const auto follow_cameras = [&] {
        const CameraRefinement* const moved = training.state().cameras.take_changed();
        if (moved == nullptr) return;
        iteration.set_cameras(moved->cameras());
        if (callbacks.on_cameras) callbacks.on_cameras(*moved);
    };

    Buffer<float, Device> dropout_space;
    while (training.state().done < options.iterations) {
        // A rollback replaces the state.
        TrainState<Device>& s = training.state();
        const int step = s.done + 1;
        if (callbacks.stop_requested && callbacks.stop_requested()) {
            training.stop();
            break;
        }
        if (callbacks.save_due && callbacks.save_due(s.done) && !training.save()) continue;
        follow_cameras();
        if (step == 1) iteration.prepare(0, true, s.gaussians);
        if (s.voter.due(step)) iteration.clock("voting", [&] { training.vote(step); });

        // An iteration that adds or removes splats takes no step, as in the official codes. The
        // last iteration neither grows nor resets, as the result would never be trained.
        const bool last = step == options.iterations,
                   changes = s.densifier.may_change_structure(step), steps = !changes && !last;
        const DeviceView<Device>& view = iteration.fetch(step, s.sampler.view(step), s.losses,
                                                         [&] { return s.sampler.view(step + 1); });
        {
            const Dropout<Device> left_out(options.loss.photometric.dropout,
                                           std::uint64_t(options.seed), step, s.gaussians,
                                           dropout_space);
            iteration.propagate(step, view, s.gaussians, s.losses, s.field, steps,
                                s.cameras.gradient_of(step, view.index), [&](auto& values) {
                                    training.watch(step, view.index, values.span());
                                });
        }
        const bool report = callbacks.report_due && callbacks.report_due(step);
        // Check before splats are added or removed: a removed splat could no longer be named.
        if ((report || !steps || step % kCheckEvery == 0) && !training.check(step)) continue;
        if (report) callbacks.on_report(make_report(step, iteration, s));
        if (steps) {
            // A reset replaces the step of the opacities, as in the official codes.
            iteration.descend(step, s.adam, s.gaussians, !s.densifier.resets_opacity(step),
                              training.halted());
            bound_longest_axis(options.model.longest_axis, s.gaussians);
        } else {
            iteration.finish_statistics();
        }
        if (!last) iteration.clock("densify", [&] { training.grow(step, iteration); });
        s.cameras.step_done(step, options.iterations);
        training.step_done(step);
        if (after_step) after_step(step, s.gaussians);
    }
    follow_cameras();
    TrainState<Device>& end = training.state();
    for (const auto& loss : end.losses)
        if (const HeldExposures found = loss->exposures(); !found.empty() && callbacks.on_exposures)
            callbacks.on_exposures(found);
    if (callbacks.on_end) callbacks.on_end(end.done);
    return std::move(end.gaussians);
}

}  // namespace tvsgs
