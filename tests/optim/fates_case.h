// A view with priors and neighbour views, and a term evaluated on it on either device.
#pragma once

#include "core/scene/prior_maps.h"
#include "optim/losses/losses_list.h"
#include "render/tiles/view_splats.h"
#include "support/random_gaussians.h"

namespace tvsgs::test {

struct FatesView {
    Camera camera;
    std::vector<ViewMap> maps;
};

struct FatesCase {
    FatesView view;
    std::vector<float> depth, transmittance;  // [H W]
    std::vector<std::uint8_t> photo;          // [H W 3]
    std::vector<FatesView> others;            // neighbour views, at most two
    LossOptions options;                      // exactly one term has a weight
    float length_unit = 1, min_depth = 0.1f;
    int step = 1;
};

struct FatesResult {
    double value = 0;
    std::vector<float> dL_ddepth;
};

template <class Device>
DeviceView<Device> upload_view(const FatesView& v, int index) {
    DeviceView<Device> view;
    view.index = index;
    view.camera = v.camera;
    for (const ViewMap& map : v.maps)
        view.maps.push_back(
            {map.name, map.width_px, map.height_px, map.channels, to_device<Device>(map.values)});
    return view;
}

/// Result of adding the term to an objective that is not empty: 2, and 3 per pixel.
template <class Device>
FatesResult evaluate(const FatesCase& c) {
    LossContext context;
    context.length_unit = c.length_unit;
    context.seed = 5;
    const auto losses = make_losses<Device>(c.options, context);

    Gaussians<Device> gaussians;
    resize(gaussians, 1, 0);
    std::vector<DeviceView<Device>> views;
    views.push_back(upload_view<Device>(c.view, 0));
    copy(c.photo, views[0].photo);
    std::vector<int> pairs;
    for (const FatesView& other : c.others) {
        pairs.push_back(static_cast<int>(views.size()));
        views.push_back(upload_view<Device>(other, pairs.back()));
    }
    RenderedImages<Device> images;
    images.width = c.view.camera.width_px, images.height = c.view.camera.height_px;
    images.camera = c.view.camera;
    copy(c.depth, images.depth);
    copy(c.transmittance, images.transmittance);
    std::vector<std::unique_ptr<Backbone<Device>>> backbones(2);  // no neighbour view is rendered
    NeighbourViews<Device> others({{pairs}, c.min_depth}, std::move(backbones), 5);
    others.begin(c.step, 0, views, gaussians);
    others.compare(images);

    Objective<Device> objective;
    copy(std::vector<float>(c.depth.size(), 3), objective.dL_dimages.depth);
    objective.partial.resize(kSumBlocks);
    objective.count.resize(1);
    copy(std::vector<double>{2}, objective.values);
    const TensorField<Device> field;
    losses.at(0)->add_to(
        objective,
        {gaussians, images, views[0], field, {}, c.step, others.count() > 0 ? &others : nullptr});
    FatesResult result{to_host(objective.values)[0] - 2, to_host(objective.dL_dimages.depth)};
    for (float& g : result.dL_ddepth) g -= 3;
    return result;
}

/// evaluate<Cuda>, compiled by nvcc.
FatesResult evaluate_cuda(const FatesCase& c);

}  // namespace tvsgs::test
