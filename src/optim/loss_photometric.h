#pragma once

#include "optim/loss.h"
#include "render/photometric.h"

namespace tvsgs {

template <class Device>
class PhotometricLoss final : public Loss<Device> {
public:
    explicit PhotometricLoss(const PhotometricOptions& o)
        : weights_{o.weight * (1 - o.ssim), o.weight * o.ssim} {}

    const char* name() const override { return "photometric"; }
    bool active(int) const override { return true; }

    void add_to(Objective<Device>& objective,
                double* value,
                const LossInputs<Device>& in) override {
        pixel_loss_.resize(in.images.color.size());
        photometric_loss(in.images.color.span(), in.view.photo.span(), in.images.width,
                         in.images.height, weights_, scratch_, objective.dL_dimages.color.span(),
                         pixel_loss_.span(), Device{});
        add_sum(Device{}, static_cast<int>(pixel_loss_.size()), ReadValue{pixel_loss_.span()}, 1,
                objective.partial.span(), value);
    }

private:
    PhotometricWeights weights_;
    PhotometricScratch<Device> scratch_;
    Buffer<float, Device> pixel_loss_;
};

}  // namespace tvsgs
