// The iteration on one device; included by one file per device.
#pragma once

#include <chrono>

#include "apps/bench/iteration.h"
#include "optim/loop/train_loop.h"
#include "optim/losses/losses_list.h"

namespace tvsgs {

template <class Device>
IterationTimes time_iteration(const Scene& scene,
                              const TrainOptions& options,
                              const Gaussians<Cpu>& splats,
                              int warm_up,
                              int repetitions) {
    const int step = options.iterations;
    Iteration<Device> iteration(scene, options, false);
    const std::vector<std::unique_ptr<Loss<Device>>> losses = make_terms<Device>(scene, options);
    Gaussians<Device> gaussians;
    copy(splats, gaussians);
    // At rate 0 the view stays the same.
    Adam<Device> adam({0, 0, 1, 0, 0, 0, 0, 0}, gaussians);
    Guard<Device> guard;
    TensorField<Device> field;
    const auto run_ms = [&] {
        synchronize(Device{});
        const auto begin = std::chrono::steady_clock::now();
        const DeviceView<Device>& view = iteration.fetch(step, 0, losses, [] { return 0; });
        iteration.propagate(step, view, gaussians, losses, field, true, {},
                            [&](auto& values) { guard.watch(step, view.index, values.span()); });
        iteration.descend(step, adam, gaussians, true, guard.halted());
        synchronize(Device{});
        const auto passed = std::chrono::steady_clock::now() - begin;
        return std::chrono::duration<double, std::milli>(passed).count();
    };

    IterationTimes out;
    for (int i = 0; i < warm_up; ++i) run_ms();
    for (int i = 0; i < repetitions; ++i) out.all_ms.push_back(run_ms());
    Backbone<Device>& backbone = iteration.backbone();
    backbone.clock() = StageClock<Device>(true);
    for (int i = 0; i < repetitions; ++i) {
        iteration.details = StageClock<Device>(true);
        backbone.clock().clear();
        const double all = run_ms();
        double left = all;
        auto& laps = out.laps.emplace_back();
        for (const auto* clock : {&iteration.details, &backbone.clock()})
            for (const StageTime& stage : clock->stages()) {
                laps.emplace_back(stage.name, 1e3 * stage.seconds);
                left -= 1e3 * stage.seconds;
            }
        out.unaccounted.push_back(left / all);
    }
    out.counts = backbone.counts();
    out.work = backbone.blend_work();
    out.maps = needs_at(losses, step, 0, true).maps;
    const std::vector<double> values = to_host(iteration.objective().values);
    for (std::size_t i = 0; i < values.size(); ++i)
        out.losses.emplace_back(losses[i]->key, values[i]);
    if (NeighbourViews<Device>* const others = iteration.others(); others && others->count() > 0)
        for (const int valid : to_host((*others)[0].valid())) out.compared_pixels += valid;
    out.bytes = memory_use(Device{}).current_bytes;
    return out;
}

}  // namespace tvsgs
