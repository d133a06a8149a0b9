// The smallest loss, from public headers alone: the mean squared difference between the brightness
// of the render and a map that comes with the view.  [docs/develop/add-a-loss.md]
#pragma once

#include "core/device/parallel.h"
#include "optim/losses/loss.h"

namespace tvsgs::examples {

/// One pixel: its share of the value, and the derivatives by its colour.
struct BrightnessBody {
    Span<const Vec3f> color;
    Span<const float> wanted;
    float weight_per_pixel;
    Span<float> pixel_loss;
    Span<Vec3f> dL_dcolor;  // added to

    TVSGS_HD void operator()(int i) const {
        const float off = (color[i].x + color[i].y + color[i].z) / 3 - wanted[i];
        pixel_loss[i] = weight_per_pixel * off * off;
        const float slope = weight_per_pixel * 2 * off / 3;
        dL_dcolor[i] += {slope, slope, slope};
    }
};

template <class Device>
class BrightnessLoss final : public Loss<Device> {
public:
    inline static const LossNeeds kNeeds{.view_maps = {"brightness"}};

    explicit BrightnessLoss(const ScheduledOptions& options) : options_(options) {}

    bool active(int step) const override { return step >= options_.start; }
    LossNeeds needs() const override { return kNeeds; }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        const DeviceMap<Device>* const wanted = in.view.map("brightness");
        if (wanted == nullptr) return;  // no map for this view
        const Buffer<Vec3f, Device>& color = in.images.color;
        const int pixels = static_cast<int>(color.size());
        pixel_loss_.resize(color.size());
        parallel_for(Device{}, pixels,
                     BrightnessBody{color.span(), wanted->values.span(),
                                    options_.weight / static_cast<float>(pixels),
                                    pixel_loss_.span(), objective.dL_dimages.color.span()});
        objective.add(pixel_loss_);
    }

private:
    ScheduledOptions options_;
    Buffer<float, Device> pixel_loss_;
};

}  // namespace tvsgs::examples
