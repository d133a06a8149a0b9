// The loop itself; included by one file per device.
#pragma once

#include "optim/batch.h"
#include "optim/train_state.h"

namespace tvsgs {

template <class Device>
TrainReport make_report(int step,
                        const Iteration<Device>& iteration,
                        const TrainState<Device>& state) {
    TrainReport report{
        step, 0, {}, state.gaussians.size(), memory_use(Device{}), iteration.clock.stages()};
    const std::vector<double> values = to_host(iteration.objective().values);
    for (std::size_t i = 0; i < values.size(); ++i) {
        report.terms.emplace_back(state.losses[i]->name(), values[i]);
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
    check_batch(scene, options, size_of(callbacks.peers));
    Iteration<Device> iteration(scene, options, callbacks.goes_on);
    // A photograph can ask where it is drawn from harmonics that are fetched.
    const bool asks = !scene.fixed_splats && iteration.backbone().fuses();
    Training<Device> t(scene, options, callbacks, asks, std::move(start));
    StepBatch<Device> batch(callbacks.peers, callbacks.records_at_a_time);
    const int each = options.comm.batch;  // photographs of a step
    iteration.clock = StageClock<Device>(callbacks.profile);
    const auto follow_cameras = [&] {
        const CameraRefinement* const moved = t->cameras.take_moved();
        if (moved == nullptr) return;
        iteration.set_cameras(moved->cameras());
        if (callbacks.on_cameras) callbacks.on_cameras(*moved);
    };

    const SplatsNow<Device> splats_now = [&t]() -> const Gaussians<Device>& {
        t->adam.catch_up(t->gaussians);
        return t->gaussians;
    };
    if (t->adam.fetches())
        iteration.backbone().set_harmonics(
            [&t](const SplatPlaces& places, std::size_t room, int sh_degree) {
                return t->adam.fetch_harmonics(places, room, sh_degree, t->gaussians);
            });

    // A step is the iterations [first, step].
    while (t->done < options.iterations) {
        const int first = t->done + 1, step = std::min(t->done + each, options.iterations);
        if (callbacks.peers != nullptr) callbacks.peers->set_iteration(step);
        if (callbacks.stop_requested && callbacks.stop_requested()) {
            t.stop();
            break;
        }
        if (callbacks.save_due && callbacks.save_due(first - 1) && !t.save()) continue;
        follow_cameras();
        if (first == 1) iteration.prepare(0, 0, true, t->gaussians);
        if (t->voter.due(step, each)) iteration.clock("voting", [&] { t.vote(step); });

        // Where splats come and go, gradients are lost, as in the official codes.
        const bool changes = t->densifier.may_change_structure(step);
        const bool steps = !changes && step < options.iterations;
        if (t.batched()) {
            batch.propagate(first, step, iteration, t, steps);
        } else {
            const DeviceView<Device>& view =
                iteration.fetch(step, t->sampler.view(step), t->losses,
                                [&] { return std::pair(step + 1, t->sampler.view(step + 1)); });
            iteration.propagate(step, step, view, t->gaussians, t->losses, t->field, steps,
                                t->cameras.gradient_of(step, view.index),
                                [&](auto& values) { t.watch(step, view.index, values.span()); });
        }
        const bool report = callbacks.report_due && callbacks.report_due(step);
        // A splat that is pruned could no longer be named.
        const bool look = report || changes || passes_multiple(step, each, kCheckEvery) || !steps;
        const bool far = changes || !steps || passes_multiple(step, each, kCheckFarEvery);
        if (look && !t.check(step, far)) continue;
        if (report) callbacks.on_report(make_report(step, iteration, t.state()));
        if (steps)
            iteration.descend(
                step, t->adam, t->gaussians,
                !(options.optim.skip_step_on_structure_change && t->densifier.resets_opacity(step)),
                t.halted(), t.batched() ? &batch.gradients() : nullptr, step - first + 1);
        else
            iteration.finish_statistics();
        // What the last iteration grew or faded no other would train.
        if (step < options.iterations)
            iteration.clock("densify", [&] { t.grow(first, step, iteration); });
        t->cameras.step_done(step, options.iterations);
        t.step_done(step);
        if (after_step) after_step(step, splats_now);
    }
    follow_cameras();
    for (const auto& loss : t->losses)
        if (const HeldExposures found = loss->exposures(); !found.empty() && callbacks.on_exposures)
            callbacks.on_exposures(found);
    if (callbacks.on_end) callbacks.on_end(t->done);
    return std::move(t->gaussians);
}

}  // namespace tvsgs
