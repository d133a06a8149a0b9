// The iteration on one device; included by one file per device.
#pragma once

#include "apps/bench/iteration.h"
#include "optim/loop/train_loop.h"
#include "optim/losses/losses_list.h"

namespace tvsgs {

template <class Device>
struct BenchIteration<Device>::Parts {
    int step;
    Iteration<Device> iteration;
    std::vector<std::unique_ptr<Loss<Device>>> losses;
    Gaussians<Device> splats;
    Adam<Device> adam;
    Guard<Device> guard;
    TensorField<Device> field;

    Parts(const Scene& scene, const TrainOptions& options, const Gaussians<Cpu>& from)
        : step(options.iterations),
          iteration(scene, options, false),
          losses(make_terms<Device>(scene, options)),
          splats(copy_of(from)),
          // At rate 0 the view stays the same.
          adam({0, 0, 1, 0, 0, 0, 0, 0}, splats) {}

    static Gaussians<Device> copy_of(const Gaussians<Cpu>& from) {
        Gaussians<Device> to;
        copy(from, to);
        return to;
    }
};

template <class Device>
BenchIteration<Device>::BenchIteration(const Scene& scene,
                                       TrainOptions options,
                                       const Gaussians<Cpu>& splats)
    : parts_(std::make_unique<Parts>(scene, options, splats)) {}
template <class Device>
BenchIteration<Device>::BenchIteration(BenchIteration&&) noexcept = default;
template <class Device>
BenchIteration<Device>::~BenchIteration() = default;

template <class Device>
void BenchIteration<Device>::run(StageClock<Device>& clock) {
    Parts& p = *parts_;
    std::swap(p.iteration.details, clock);
    const DeviceView<Device>& view = p.iteration.fetch(p.step, 0, p.losses, [] { return 0; });
    p.iteration.propagate(p.step, view, p.splats, p.losses, p.field, true, {},
                          [&](auto& values) { p.guard.watch(p.step, view.index, values.span()); });
    p.iteration.descend(p.step, p.adam, p.splats, true, p.guard.halted());
    std::swap(p.iteration.details, clock);
}

template <class Device>
Backbone<Device>& BenchIteration<Device>::backbone() {
    return parts_->iteration.backbone();
}

template <class Device>
Maps BenchIteration<Device>::maps() const {
    return needs_at(parts_->losses, parts_->step, 0, true).maps;
}

template <class Device>
std::vector<std::pair<std::string, double>> BenchIteration<Device>::losses() const {
    const std::vector<double> values = to_host(parts_->iteration.objective().values);
    std::vector<std::pair<std::string, double>> out;
    for (std::size_t i = 0; i < values.size(); ++i)
        out.emplace_back(parts_->losses[i]->key, values[i]);
    return out;
}

template <class Device>
int BenchIteration<Device>::compared_pixels() const {
    NeighbourViews<Device>* const others = parts_->iteration.others();
    if (others == nullptr || others->count() == 0) return 0;
    int count = 0;
    for (const int valid : to_host((*others)[0].valid())) count += valid;
    return count;
}

}  // namespace tvsgs
