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
    static constexpr LossNeeds kNeeds{.maps = Maps::distortion};

    /// The map is in squared disparities.
    explicit DistortionLoss(const ScheduledOptions& options, const LossContext& context = {})
        : options_(options) {
        options_.weight *= context.length_unit * context.length_unit;
    }

    bool active(int step) const override { return step >= options_.start; }
    LossNeeds needs() const override { return kNeeds; }

    void add_to(Objective<Device>& objective,
                double* value,
                const LossInputs<Device>& in) override {
        const int pixels = in.images.width * in.images.height;
        const float weight = options_.weight / static_cast<float>(pixels);
        add_sum(Device{}, pixels, ReadValue{in.images.distortion.span()}, weight,
                objective.partial.span(), value);
        parallel_for(Device{}, pixels,
                     AddConstantBody{weight, objective.dL_dimages.distortion.span()});
    }

private:
    ScheduledOptions options_;
};

struct DistortionEntry {
    ScheduledOptions distortion{0, 3001};
    static constexpr const char* kKey = "distortion";
    static constexpr const char* kMeaning = "spread of the depths that a pixel blends (2DGS)";
    static constexpr auto kOptions = &DistortionEntry::distortion;
    template <class Device>
    using Term = DistortionLoss<Device>;
};

}  // namespace tvsgs
