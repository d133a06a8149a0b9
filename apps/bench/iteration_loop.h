// The iteration itself; included by one file per device. It follows optim/train_loop.h.
#pragma once

#include "apps/bench/iteration.h"
#include "optim/losses_list.h"
#include "optim/train_loop.h"

namespace tvsgs {

template <class Device>
struct BenchIteration<Device>::Parts {
    TrainOptions options;
    DeviceViews<Device> views;
    std::unique_ptr<Backbone<Device>> backbone;
    std::unique_ptr<NeighbourView<Device>> neighbours;
    std::vector<std::unique_ptr<Loss<Device>>> losses;
    std::vector<std::string> stages;  // of the losses
    LossNeeds want;
    Gaussians<Device> splats;
    Adam<Device> adam;
    Guard<Device> guard;
    Objective<Device> objective;
    TensorField<Device> field;
    NeighbourView<Device>* neighbour = nullptr;  // of the last run

    Parts(const Scene& scene, TrainOptions o, const Gaussians<Cpu>& from)
        : options(std::move(o)),
          views(scene.train, needs_of(options.loss), options.photo_bytes),
          backbone(make_backbone<Device>(options.backbone, options.core)),
          neighbours(make_neighbour_view<Device>(scene, options)),
          losses(make_terms<Device>(scene, options)),
          want(needs_at(losses, options.iterations, true)),
          splats(copy_of(from)),
          adam({0, 0, 1, 0, 0, 0, 0, 0}, splats) {
        for (const auto& term : losses) stages.push_back(std::string(term->name()) + " loss");
        objective.values.resize(losses.size());
        objective.partial.resize(kSumBlocks);
        objective.count.resize(1);
    }

    static Gaussians<Device> copy_of(const Gaussians<Cpu>& from) {
        Gaussians<Device> to;
        copy(from, to);
        return to;
    }

    Maps maps() const { return want.maps; }
};

template <class Device>
BenchIteration<Device>::BenchIteration(const Scene& scene,
                                       TrainOptions options,
                                       const Gaussians<Cpu>& splats)
    : parts_(std::make_unique<Parts>(scene, std::move(options), splats)) {}
template <class Device>
BenchIteration<Device>::BenchIteration(BenchIteration&&) noexcept = default;
template <class Device>
BenchIteration<Device>::~BenchIteration() = default;

template <class Device>
void BenchIteration<Device>::run(StageClock<Device>& clock) {
    Parts& p = *parts_;
    const int step = p.options.iterations;
    const DeviceView<Device>& view = p.views.get(0);
    p.neighbour = !p.want.neighbour ? nullptr : clock("neighbour render", [&] {
        return p.neighbours->render(step, view.index, p.views.views(), p.splats);
    });
    const RenderedImages<Device>& images =
        p.backbone->forward(p.splats, view.camera, sh_degree_at(p.options.model, step), p.maps());
    clock("clear gradients", [&] {
        reset(p.objective, p.splats, p.want.splat_gradients, !p.backbone->fuses(), images);
    });
    if (p.neighbour) clock("compare views", [&] { p.neighbour->compare(images); });
    for (std::size_t i = 0; i < p.losses.size(); ++i)
        if (p.losses[i]->active(step))
            clock(p.stages[i].c_str(), [&] {
                p.losses[i]->add_to(p.objective, p.objective.values.data() + i,
                                    {p.splats, images, view, p.field,
                                     p.backbone->statistics().radii_px.span(), step, p.neighbour});
            });
    clock("watch losses", [&] { p.guard.watch(step, view.index, p.objective.values); });
    if (p.neighbour)
        clock("neighbour backward",
              [&] { p.neighbour->backward(p.splats, p.objective.dL_dgaussians); });
    const ViewGradients* const fused = propagate_back(*p.backbone, p.splats, p.objective);
    clock("project backward and Adam", [&] {
        descend(p.adam, step, 1, sh_degree_at(p.options.model, step), fused, p.objective, p.splats,
                true, p.guard.halted());
    });
}

template <class Device>
Backbone<Device>& BenchIteration<Device>::backbone() {
    return *parts_->backbone;
}

template <class Device>
Maps BenchIteration<Device>::maps() const {
    return parts_->maps();
}

template <class Device>
std::vector<std::pair<std::string, double>> BenchIteration<Device>::losses() const {
    const std::vector<double> values = to_host(parts_->objective.values);
    std::vector<std::pair<std::string, double>> out;
    for (std::size_t i = 0; i < values.size(); ++i)
        out.emplace_back(parts_->losses[i]->name(), values[i]);
    return out;
}

template <class Device>
int BenchIteration<Device>::compared_pixels() const {
    if (!parts_->neighbour) return 0;
    int count = 0;
    for (const int valid : to_host(parts_->neighbour->valid())) count += valid;
    return count;
}

}  // namespace tvsgs
