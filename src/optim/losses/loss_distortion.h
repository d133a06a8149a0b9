// Loss: splats blended in a pixel lie at one depth.
#pragma once

#include "optim/losses/loss.h"

namespace tvsgs {

struct AddConstantBody {
    float value;
    Span<float> to;
    TVSGS_HD void operator()(int at) const { to[at] += value; }
};

/// mean over pixels of RenderedImages::distortion.  [2DGS, Eq. 13]
template <class Device>
class DistortionLoss final : public Loss<Device> {
public:
    /// The map is in squared disparities.
    explicit DistortionLoss(const ScheduledOptions& options, const LossContext& context = {})
        : options_(options) {
        options_.weight *= context.length_unit * context.length_unit;
    }

    LossNeeds needs() const override { return {.maps = Maps::distortion}; }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        const int pixels = in.images.width * in.images.height;
        const float weight = options_.weight / float(pixels);
        add_sum(Device{}, pixels, ReadValue{in.images.distortion.span()}, weight,
                objective.partial.span(), objective.value());
        parallel_for(Device{}, pixels,
                     AddConstantBody{weight, objective.dL_dimages.distortion.span()});
    }

private:
    ScheduledOptions options_;
};

}  // namespace tvsgs
