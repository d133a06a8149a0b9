// The loop itself; included by one file per device.
#pragma once

#include "core/error.h"
#include "core/rng.h"
#include "core/stage_clock.h"
#include "optim/fixed_voters.h"
#include "optim/loss_normal.h"
#include "optim/train.h"

namespace tvsgs {

/// Training views without replacement: a new shuffled round whenever one is used up.
class ViewSampler {
public:
    ViewSampler(int count, std::uint64_t seed)
        : order_(static_cast<std::size_t>(count)), seed_(seed) {}

    int next() {
        const std::size_t at = drawn_ % order_.size();
        if (at == 0) shuffle(static_cast<std::uint32_t>(drawn_ / order_.size()));
        ++drawn_;
        return order_[at];
    }

private:
    void shuffle(std::uint32_t round) {
        for (std::size_t i = 0; i < order_.size(); ++i) order_[i] = static_cast<int>(i);
        for (std::size_t i = order_.size(); i > 1; --i) {
            const auto pick = static_cast<std::size_t>(
                uniform(random4(seed_, RandomStream::view_order, i, round).v[0]) *
                static_cast<float>(i));
            std::swap(order_[i - 1], order_[std::min(pick, i - 1)]);
        }
    }

    std::vector<int> order_;
    std::uint64_t seed_;
    std::size_t drawn_ = 0;
};

/// The training views on the device, with what the losses in use read.
template <class Device>
std::vector<DeviceView<Device>> upload(const std::vector<View>& views, const LossOptions& loss) {
    std::vector<DeviceView<Device>> result(views.size());
    for (std::size_t i = 0; i < views.size(); ++i) {
        const ImageU8& photo = views[i].photo;
        DeviceView<Device>& view = result[i];
        view.index = static_cast<int>(i);
        view.camera = views[i].camera;
        copy(photo.pixels, view.photo);
        if (loss.normal.weight > 0) {
            float low = 1, high = 0;
            for (int y = 1; y + 1 < photo.height; ++y)
                for (int x = 1; x + 1 < photo.width; ++x) {
                    const float e = edge_strength(photo.pixels.data(), photo.width, x, y);
                    low = std::min(low, e), high = std::max(high, e);
                }
            view.edge_min = low, view.edge_max = std::max(low, high);
        }
        if (loss.multi_view_ncc.weight > 0) {
            const ImageU8 grey = views[i].grey.empty() ? grey_of(photo) : views[i].grey;
            view.grey_width = grey.width, view.grey_height = grey.height;
            copy(grey.pixels, view.grey);
        }
    }
    return result;
}

/// What the terms that act at a step want rendered.
struct Wanted {
    bool plane = false, neighbour = false;
};
template <class Device>
Wanted wanted(const std::vector<std::unique_ptr<Loss<Device>>>& losses, int step) {
    Wanted w;
    for (const auto& term : losses)
        if (term->active(step))
            w.plane |= term->needs_plane(), w.neighbour |= term->needs_neighbour();
    return w;
}

/// Null when no term compares views: then nothing is chosen, allocated or said.
template <class Device>
std::unique_ptr<NeighbourView<Device>> make_neighbour_view(const Scene& scene,
                                                           const TrainOptions& options) {
    if (!(options.loss.multi_view_geometry.weight > 0) && !(options.loss.multi_view_ncc.weight > 0))
        return nullptr;
    return std::make_unique<NeighbourView<Device>>(
        select_neighbours(scene, options.loss.multi_view),
        make_backbone<Device>(options.backbone, options.core),
        static_cast<std::uint64_t>(options.seed));
}

/// Sizes and clears what the step adds to.
template <class Device>
void reset(Objective<Device>& objective,
           const Gaussians<Device>& gaussians,
           const RenderedImages<Device>& images) {
    objective.dL_dimages.color.resize(images.color.size());
    objective.dL_dimages.normal.resize(images.normal.size());
    objective.dL_dimages.distance.resize(images.distance.size());
    objective.dL_dimages.color.fill_zero();
    objective.dL_dimages.normal.fill_zero();
    objective.dL_dimages.distance.fill_zero();
    resize(objective.dL_dgaussians, gaussians.size(), gaussians.sh_degree);
    fill_zero(objective.dL_dgaussians);
    objective.values.fill_zero();
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
        if (!(std::abs(values[i]) < 1e300))
            throw Error(
                ExitCode::numerical,
                str("iteration ", step, ": the loss term '", losses[i]->name(), "' is ", values[i],
                    "; expected a finite number; lower the learning rates (--set lr.*)"));
        report.terms.emplace_back(losses[i]->name(), values[i]);
        report.loss += values[i];
    }
    return report;
}

template <class Device>
Gaussians<Device> train(const Scene& scene,
                        const TrainOptions& options,
                        const TrainCallbacks& callbacks,
                        const AfterStep<Device>& after_step) {
    const auto seed = static_cast<std::uint64_t>(options.seed);
    Gaussians<Device> gaussians;
    copy(init_gaussians(scene, options.init, options.model.sh_degree), gaussians);
    auto backbone = make_backbone<Device>(options.backbone, options.core);
    // A third of the depth: close to 1 on DTU as PGSR's authors normalise it, where the published
    // weights come from.
    const float depth = options.loss.length_unit == LengthUnit::depth ? median_depth(scene) : 0;
    auto losses = make_losses<Device>(
        options.loss, {depth > 0 ? depth / 3 : 1, static_cast<int>(scene.train.size()), seed,
                       options.core.pixel_center});
    auto neighbours = make_neighbour_view<Device>(scene, options);
    TensorVoter<Device> voter(options.tv);
    if (options.tv.enabled && !scene.fixed_voters.positions.empty())
        voter.set_fixed_voters(make_fixed_voters(scene.fixed_voters, options.tv.fixed_voters));
    TensorField<Device> field;
    Adam<Device> adam(options.lr, gaussians);
    Densifier<Device> densifier(options.densify, scene.extent, seed);
    ViewSampler sampler(static_cast<int>(scene.train.size()), seed);
    Objective<Device> objective;
    objective.values.resize(losses.size());
    objective.partial.resize(kSumBlocks);
    objective.count.resize(1);
    const auto views = upload<Device>(scene.train, options.loss);
    StageClock<Device> clock(callbacks.profile);

    for (int step = 1; step <= options.iterations; ++step) {
        if (callbacks.stop_requested && callbacks.stop_requested()) break;
        const int sh_degree = sh_degree_at(options.model, step);
        const DeviceView<Device>& view = views[static_cast<std::size_t>(sampler.next())];
        if (voter.due(step)) clock("voting", [&] { voter.vote(step, gaussians, field); });

        const Wanted want = wanted(losses, step);
        NeighbourView<Device>* const neighbour =
            !want.neighbour ? nullptr : clock("neighbour", [&] {
                return neighbours->render(step, view.index, views, gaussians);
            });
        const RenderedImages<Device>& images =
            clock("forward", [&]() -> const RenderedImages<Device>& {
                return backbone->forward(
                    gaussians, view.camera, sh_degree,
                    want.plane || neighbour ? Channels::color_plane : Channels::color);
            });
        clock("losses", [&] {
            reset(objective, gaussians, images);
            if (neighbour) neighbour->compare(images);
            for (std::size_t i = 0; i < losses.size(); ++i)
                if (losses[i]->active(step))
                    losses[i]->add_to(objective, objective.values.data() + i,
                                      {gaussians, images, view, field,
                                       backbone->statistics().radii_px.span(), step, neighbour});
        });
        clock("backward", [&] {
            backbone->backward(gaussians, objective.dL_dimages, objective.dL_dgaussians);
            if (neighbour) neighbour->backward(gaussians, objective.dL_dgaussians);
        });
        if (callbacks.report_due && callbacks.report_due(step))
            callbacks.on_report(make_report(step, objective, losses, gaussians, clock));

        const auto event = clock("densify", [&] {
            return densifier.step(
                step, backbone->statistics(), gaussians, adam, [&](const auto& count_views) {
                    resize(objective.dL_dgaussians, gaussians.size(), gaussians.sh_degree);
                    for (const auto& other : views) {
                        backbone->forward(gaussians, other.camera, 0, Channels::plane);
                        backbone->backward(gaussians, {}, objective.dL_dgaussians);
                        count_views(backbone->statistics());
                    }
                });
        });
        if (event.structure_changed) voter.structure_changed(densifier.parents(), field);
        // The gradients belong to the splats before the change; the official codes lose them here
        // too.
        if (!event.structure_changed && step < options.iterations)
            clock("adam", [&] {
                adam.step(step, scene.extent, sh_degree, objective.dL_dgaussians, gaussians,
                          !(event.opacity_reset && options.optim.skip_step_on_structure_change));
            });
        if (after_step) after_step(step, gaussians);
    }
    return gaussians;
}

}  // namespace tvsgs
