// Inputs of a loss on the host, and its evaluation on either device.
#pragma once

#include "optim/losses/losses_list.h"
#include "support/random_gaussians.h"

namespace tvsgs::test {

struct LossCase {
    Gaussians<Cpu> gaussians;
    std::vector<float> radii_px;                // [N]
    std::vector<Vec3f> voted_normals, targets;  // [N]
    std::vector<std::uint8_t> flags;            // [N]; empty: no voting event yet
    Camera camera;                              // camera and images are for terms over images
    std::vector<Vec3f> normal;                  // [H W]
    std::vector<float> transmittance, depth, expected_depth, distortion;
    std::vector<std::uint8_t> photo;  // [H W 3]
    float edge_min = 0, edge_max = 1;
    std::vector<ViewMap> maps{};  // of the view
};

enum class Term {
    flatten,
    normal,
    normal_consistency,
    two_depths,  // normal_consistency of both depth maps, for any coverage
    distortion,
    tv_normal,
    tv_position
};

struct LossResult {
    double value = 0;
    std::vector<Vec3f> dL_dmeans, dL_dlog_scales, dL_dnormal;
    std::vector<Quatf> dL_dquats;
    std::vector<float> dL_ddepth, dL_dexpected_depth, dL_ddistortion;
};

/// Result of adding a term `times` to an objective that is not empty.
template <class Device>
LossResult evaluate(const LossCase& c, Loss<Device>& loss, int step = 1, int times = 1) {
    Gaussians<Device> gaussians;
    copy(c.gaussians, gaussians);
    RenderedImages<Device> images;
    images.width = c.camera.width_px, images.height = c.camera.height_px;
    images.camera = c.camera;
    copy(c.normal, images.normal);
    copy(c.transmittance, images.transmittance);
    copy(c.depth, images.depth);
    copy(c.expected_depth, images.expected_depth);
    copy(c.distortion, images.distortion);
    DeviceView<Device> view;
    view.camera = c.camera;
    copy(c.photo, view.photo);
    for (const ViewMap& map : c.maps)
        view.maps.push_back(
            {map.name, map.width_px, map.height_px, map.channels, to_device<Device>(map.values)});
    view.edge_min = c.edge_min, view.edge_max = c.edge_max;
    TensorField<Device> field;
    copy(c.voted_normals, field.normals);
    copy(c.targets, field.targets);
    copy(c.flags, field.flags);
    const Buffer<float, Device> radii = to_device<Device>(c.radii_px);

    Objective<Device> objective;
    resize(objective.dL_dgaussians, gaussians.size(), gaussians.sh_degree);
    fill_zero(objective.dL_dgaussians);
    auto& dL = objective.dL_dimages;
    const auto clear_like = [](const auto& image, auto& gradient) {
        gradient.resize(image.size());
        gradient.fill_zero();
    };
    clear_like(c.normal, dL.normal);
    clear_like(c.depth, dL.depth);
    clear_like(c.expected_depth, dL.expected_depth);
    clear_like(c.distortion, dL.distortion);
    objective.partial.resize(kSumBlocks);
    objective.count.resize(1);
    copy(std::vector<double>{2}, objective.values);  // a term adds, it never overwrites
    for (int i = 0; i < times; ++i)
        loss.add_to(objective, {gaussians, images, view, field, radii.span(), step});
    return {to_host(objective.values)[0] - 2,
            to_host(objective.dL_dgaussians.means),
            to_host(objective.dL_dgaussians.log_scales),
            to_host(dL.normal),
            to_host(objective.dL_dgaussians.quats),
            to_host(dL.depth),
            to_host(dL.expected_depth),
            to_host(dL.distortion)};
}

template <class Device>
LossResult evaluate(
    const LossCase& c, Term term, float weight, Reduction reduction, int times = 1) {
    const ScheduledOptions options{weight, 1};
    LossContext context;
    context.shared.tv_reduction = reduction;
    std::unique_ptr<Loss<Device>> loss;
    switch (term) {
        case Term::flatten:
            loss = std::make_unique<FlattenLoss<Device>>(options);
            break;
        case Term::normal:
            loss = std::make_unique<NormalLoss<Device>>(options);
            break;
        case Term::normal_consistency:
            loss = std::make_unique<NormalConsistencyLoss<Device>>(
                NormalConsistencyOptions{{weight, 1}});
            break;
        case Term::two_depths:
            loss = std::make_unique<NormalConsistencyLoss<Device>>(
                NormalConsistencyOptions{{weight, 1}, 0.4f, false});
            break;
        case Term::distortion:
            loss = std::make_unique<DistortionLoss<Device>>(options, LossContext{.length_unit = 3});
            break;
        case Term::tv_normal:
            loss = std::make_unique<TvLoss<Device, false>>(options, context);
            break;
        case Term::tv_position:
            loss = std::make_unique<TvLoss<Device, true>>(options, context);
            break;
    }
    return evaluate(c, *loss, 1, times);
}

/// Evaluates the only term with a weight.
template <class Device>
LossResult evaluate(const LossCase& c,
                    const LossOptions& options,
                    const LossContext& context,
                    int step) {
    return evaluate(c, *make_losses<Device>(options, context).at(0), step);
}

/// evaluate<Cuda>, compiled by nvcc.
LossResult evaluate_cuda(const LossCase& c, Term term, float weight, Reduction reduction);
LossResult evaluate_cuda(const LossCase& c,
                         const LossOptions& options,
                         const LossContext& context,
                         int step);

}  // namespace tvsgs::test
