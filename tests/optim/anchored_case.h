// Two views made up by a test, and the anchored depth term evaluated on them over several steps.
#pragma once

#include "multiview_case.h"

namespace tvsgs::test {

struct AnchoredCase {
    ViewMaps reference, other;
    std::vector<float> order, confidence;  // maps of the reference view; empty: it has none
    AnchoredDepthOptions options;
    float length_unit = 1;
    bool alone = false;                             // the reference has no neighbour view
    std::vector<int> steps;                         // steps at which the term acts
    std::vector<float> depth_scales, order_scales;  // of render and prior at each step; empty: 1
};

struct AnchoredResult {
    std::vector<double> values;       // of each step
    std::vector<float> dL_ddepth;     // of the last step
    std::vector<float> target;        // after the last step
    std::vector<float> first_target;  // after the first step
};

/// `resume_before`: before this step (index) a new term with the saved state replaces the term.
template <class Device>
AnchoredResult evaluate(const AnchoredCase& c, std::size_t resume_before = 1000) {
    const auto make = [&] {
        return std::make_unique<AnchoredDepthLoss<Device>>(
            c.options, LossContext{.length_unit = c.length_unit, .views = 2});
    };
    auto loss = make();
    Gaussians<Device> gaussians;
    resize(gaussians, 1, 0);
    std::vector<DeviceView<Device>> views;
    views.push_back(upload_view<Device>(c.reference, 0));
    views.push_back(upload_view<Device>(c.other, 1));
    const auto add_map = [&](std::string_view name, std::vector<float> values, float scale) {
        const Camera& camera = c.reference.camera;
        for (float& v : values) v *= scale;
        if (!values.empty())
            views[0].maps.push_back(
                {name, camera.width_px, camera.height_px, 1, to_device<Device>(values)});
    };
    std::vector<std::unique_ptr<Backbone<Device>>> backbones;
    backbones.push_back(std::make_unique<PreparedImages<Device>>(c.other));
    NeighbourViews<Device> others({{{1}, {0}}, 0.1f}, std::move(backbones), 5);

    Objective<Device> objective;
    objective.dL_dimages.depth.resize(c.reference.depth.size());
    objective.partial.resize(kSumBlocks);
    objective.count.resize(1);
    const TensorField<Device> field;
    AnchoredResult result;
    for (std::size_t i = 0; i < c.steps.size(); ++i) {
        const int step = c.steps[i];
        if (i == resume_before) {
            State state;
            StateVisitor<Device> save(state);
            loss->state(save);
            loss = make();
            StateVisitor<Device> load(static_cast<const State&>(state));
            loss->state(load);
        }
        ViewMaps scaled = c.reference;
        if (!c.depth_scales.empty())
            for (float& d : scaled.depth) d *= c.depth_scales[i];
        views[0].maps.clear();
        add_map(prior_map::kDepthOrder, c.order, c.order_scales.empty() ? 1 : c.order_scales[i]);
        add_map(prior_map::kConfidence, c.confidence, 1);
        RenderedImages<Device> images = upload_maps<Device>(scaled);
        const bool looks = !c.alone && loss->needs_at(step, 0).neighbour_views > 0;
        if (looks) {
            others.begin(step, 0, views, gaussians);
            others.compare(images);
        }
        objective.dL_dimages.depth.fill_zero();
        copy(std::vector<double>{2}, objective.values);  // a term adds, it never overwrites
        loss->add_to(objective,
                     {gaussians, images, views[0], field, {}, step, looks ? &others : nullptr});
        result.values.push_back(to_host(objective.values)[0] - 2);
        if (i == 0) result.first_target = to_host(loss->target(0));
    }
    result.dL_ddepth = to_host(objective.dL_dimages.depth);
    result.target = to_host(loss->target(0));
    return result;
}

/// evaluate<Cuda>, compiled by nvcc.
AnchoredResult evaluate_cuda(const AnchoredCase& c, std::size_t resume_before = 1000);

}  // namespace tvsgs::test
