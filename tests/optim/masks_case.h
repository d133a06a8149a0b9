// Inputs of the photometric term with masks and a background, and its evaluation on either device.
#pragma once

#include "optim/losses/loss_photometric.h"
#include "support/random_gaussians.h"

namespace tvsgs::test {

struct MaskCase {
    int width = 12, height = 10, step = 3;
    std::vector<Vec3f> color;
    std::vector<float> transmittance, mask, confidence;  // mask empty: the view has none
    std::vector<std::uint8_t> photo;
    Camera camera{12, 10, 9, 9, 6, 5, {}};
    PhotometricOptions options;
};
struct MaskResult {
    double value = 0;
    std::vector<Vec3f> dL_dcolor;
    std::vector<float> dL_dtransmittance;
    std::vector<float> exposure;  // moments of its first step; empty: no exposure
};

template <class Device>
MaskResult evaluate_masks(const MaskCase& c) {
    PhotometricLoss<Device> loss(c.options, {.seed = 7});
    const Gaussians<Device> gaussians;
    RenderedImages<Device> images;
    images.width = c.width, images.height = c.height;
    copy(c.color, images.color), copy(c.transmittance, images.transmittance);
    DeviceView<Device> view;
    copy(c.photo, view.photo);
    view.camera = c.camera;
    view.maps.push_back({"mask", c.width, c.height, 1, to_device<Device>(c.mask)});
    view.maps.push_back(
        {prior_map::kConfidence, c.width, c.height, 1, to_device<Device>(c.confidence)});
    const TensorField<Device> field;
    Objective<Device> objective;
    auto& dL = objective.dL_dimages;
    dL.color.resize(c.color.size()), dL.color.fill_zero();
    if (has(loss.needs().maps, Maps::coverage))
        dL.transmittance.resize(c.color.size()), dL.transmittance.fill_zero();
    objective.partial.resize(kSumBlocks);
    copy(std::vector<double>{0}, objective.values);
    loss.add_to(objective, {gaussians, images, view, field, {}, c.step});
    MaskResult result{
        to_host(objective.values)[0], to_host(dL.color), to_host(dL.transmittance), {}};
    for (const ExposureState& state : to_host(loss.exposure().states()))
        result.exposure = {state.m[0], state.m[1]};
    return result;
}
MaskResult evaluate_masks_cuda(const MaskCase& c);

}  // namespace tvsgs::test
