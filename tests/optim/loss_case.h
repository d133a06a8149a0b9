// Inputs of one loss evaluation on the host, and the evaluation on either device.
#pragma once

#include "optim/losses_list.h"
#include "support/random_gaussians.h"

namespace tvsgs::test {

struct LossCase {
    Gaussians<Cpu> gaussians;
    std::vector<float> radii_px;                // [N]
    std::vector<Vec3f> voted_normals, targets;  // [N]
    std::vector<std::uint8_t> flags;            // [N]; empty: no voting event yet
    Camera camera;                              // the rest is for the normal loss
    std::vector<Vec3f> normal;                  // [H W]
    std::vector<float> transmittance, depth;
    std::vector<std::uint8_t> photo;  // [H W 3]
    float edge_min = 0, edge_max = 1;
};

enum class Term { flatten, normal, tv_normal, tv_position };

struct LossResult {
    double value = 0;
    std::vector<Vec3f> dL_dmeans, dL_dlog_scales, dL_dnormal;
    std::vector<Quatf> dL_dquats;
    std::vector<float> dL_ddepth;
};

/// What the term adds to an objective that already holds something.
template <class Device>
LossResult evaluate(const LossCase& c, Term term, float weight, Reduction reduction) {
    ScheduledOptions options{weight, 1};
    std::unique_ptr<Loss<Device>> loss;
    switch (term) {
        case Term::flatten:
            loss = std::make_unique<FlattenLoss<Device>>(options);
            break;
        case Term::normal:
            loss = std::make_unique<NormalLoss<Device>>(options);
            break;
        case Term::tv_normal:
            loss = std::make_unique<TvLoss<Device, false>>(options, reduction);
            break;
        case Term::tv_position:
            loss = std::make_unique<TvLoss<Device, true>>(options, reduction);
            break;
    }
    Gaussians<Device> gaussians;
    copy(c.gaussians, gaussians);
    RenderedImages<Device> images;
    images.width = c.camera.width_px, images.height = c.camera.height_px;
    images.camera = c.camera;
    copy(c.normal, images.normal);
    copy(c.transmittance, images.transmittance);
    copy(c.depth, images.depth);
    DeviceView<Device> view;
    view.camera = c.camera;
    copy(c.photo, view.photo);
    view.edge_min = c.edge_min, view.edge_max = c.edge_max;
    TensorField<Device> field;
    copy(c.voted_normals, field.normals);
    copy(c.targets, field.targets);
    copy(c.flags, field.flags);
    const Buffer<float, Device> radii = to_device<Device>(c.radii_px);

    Objective<Device> objective;
    resize(objective.dL_dgaussians, gaussians.size(), gaussians.sh_degree);
    fill_zero(objective.dL_dgaussians);
    objective.dL_dimages.normal.resize(c.normal.size());
    objective.dL_dimages.normal.fill_zero();
    objective.dL_dimages.depth.resize(c.depth.size());
    objective.dL_dimages.depth.fill_zero();
    objective.partial.resize(kSumBlocks);
    objective.count.resize(1);
    copy(std::vector<double>{2}, objective.values);  // a term adds, it never overwrites
    loss->add_to(objective, objective.values.data(),
                 {gaussians, images, view, field, radii.span(), 1});
    return {to_host(objective.values)[0] - 2,
            to_host(objective.dL_dgaussians.means),
            to_host(objective.dL_dgaussians.log_scales),
            to_host(objective.dL_dimages.normal),
            to_host(objective.dL_dgaussians.quats),
            to_host(objective.dL_dimages.depth)};
}

/// evaluate<Cuda>, compiled by nvcc.
LossResult evaluate_cuda(const LossCase& c, Term term, float weight, Reduction reduction);

}  // namespace tvsgs::test
