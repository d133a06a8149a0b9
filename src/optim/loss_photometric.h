// The render against its photograph.
#pragma once

#include "optim/exposure.h"
#include "optim/loss.h"
#include "render/photometric.h"

namespace tvsgs {

template <class Device>
class PhotometricLoss final : public Loss<Device> {
public:
    static constexpr LossNeeds kNeeds{};

    PhotometricLoss(const PhotometricOptions& o, int views)
        : weights_{o.weight * (1 - o.ssim), o.weight * o.ssim},
          exposure_start_(o.exposure ? o.exposure_start : 0),
          views_(views) {}

    const char* name() const override { return "photometric"; }
    bool active(int) const override { return true; }
    LossNeeds needs() const override { return kNeeds; }

    void add_to(Objective<Device>& objective,
                double* value,
                const LossInputs<Device>& in) override {
        pixel_loss_.resize(in.images.color.size());
        const int pixels = static_cast<int>(pixel_loss_.size());
        const bool expose = exposure_start_ > 0 && in.step >= exposure_start_;
        PhotometricWeights weights = weights_;
        if (expose) weights.l1 = 0;  // SSIM always looks at the render itself
        photometric_loss(in.images.color.span(), in.view.photo.span(), in.images.width,
                         in.images.height, weights, scratch_, objective.dL_dimages.color.span(),
                         pixel_loss_.span(), Device{});
        if (expose) {
            ssim_loss_.resize(1);
            ssim_loss_.fill_zero();
            add_sum(Device{}, pixels, ReadValue{pixel_loss_.span()}, 1, objective.partial.span(),
                    ssim_loss_.data());
            // Officially from 1 - SSIM < 0.5 on; without an SSIM term always.
            exposure_.add_l1(in, views_, weights_.l1, ssim_loss_.data(),
                             weights.ssim > 0 ? 0.5 * static_cast<double>(weights.ssim) : 1,
                             objective, pixel_loss_.span());
        }
        add_sum(Device{}, pixels, ReadValue{pixel_loss_.span()}, 1, objective.partial.span(),
                value);
    }

    void state(StateVisitor<Device>& visit) override { exposure_.state(visit); }

    const Exposure<Device>& exposure() const { return exposure_; }

private:
    PhotometricWeights weights_;
    int exposure_start_;  // 0: never
    int views_;
    PhotometricScratch<Device> scratch_;
    Exposure<Device> exposure_;
    Buffer<float, Device> pixel_loss_;
    Buffer<double, Device> ssim_loss_;
};

}  // namespace tvsgs
