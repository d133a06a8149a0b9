// Loss: depth is smooth where a prior is smooth.
#pragma once

#include "optim/losses/depth_prior_math.h"
#include "optim/losses/loss.h"

namespace tvsgs {

/// The cost of a pixel's steps to the right and down, and the derivatives of all four steps.
struct DepthSmoothBody {
    // Steps up to this cost nothing, in length units of the losses.
    static constexpr float kTolerance = 1e-4f;
    static constexpr float kPriorStep = 0.01f;  // a larger step of the prior is an edge

    int width, height;
    Span<const float> depth, transmittance, order, confidence;
    float per_length;                  // length units of the losses per world unit
    float weight_across, weight_down;  // per step along each axis
    Span<float> pixel_loss;            // overwritten
    Span<float> dL_ddepth;             // added to

    TVSGS_HD bool known(int at) const {
        return depth[at] > 0 && transmittance[at] <= 0.5f && confidence_at(confidence, at) > 0;
    }
    TVSGS_HD Penalty<float> step(int p, int q) const {
        // Written so that NaN counts as an edge.
        if (!(std::abs(order[q] - order[p]) < kPriorStep) || !known(p) || !known(q)) return {};
        return smooth_pair(per_length * depth[p], per_length * depth[q], kTolerance);
    }

    TVSGS_HD void operator()(int at) const {
        const int x = at % width, y = at / width;
        float loss = 0, slope = 0;
        if (x + 1 < width) {
            const auto right = step(at, at + 1);
            loss += weight_across * right.value, slope -= weight_across * right.slope;
        }
        if (y + 1 < height) {
            const auto below = step(at, at + width);
            loss += weight_down * below.value, slope -= weight_down * below.slope;
        }
        if (x > 0) slope += weight_across * step(at - 1, at).slope;
        if (y > 0) slope += weight_down * step(at - width, at).slope;
        pixel_loss[at] = loss;
        dL_ddepth[at] += per_length * slope;
    }
};

/// mean over steps between neighbours along x, and the same along y, of [|D_q - D_p| - tolerance]+.
/// Steps cost nothing, but count in the mean, across an edge of the prior and if a pixel has no
/// depth, no prior, or a coverage below one half. [docs/method/fates.md#smoothness]
template <class Device>
class DepthSmoothLoss final : public Loss<Device> {
public:
    explicit DepthSmoothLoss(const ScheduledOptions& options, const LossContext& context = {})
        : options_(options), length_unit_(context.length_unit) {}

    LossNeeds needs() const override {
        return {.maps = Maps::depth, .view_maps = {prior_map::kDepthOrder, prior_map::kConfidence}};
    }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        const auto order = prior_values(in.view, prior_map::kDepthOrder);
        if (order.empty()) return;
        const auto& images = in.images;
        const int w = images.width, h = images.height;
        const auto mean_of = [&](int steps) {
            return steps > 0 ? options_.weight / float(steps) : 0.0f;
        };
        pixel_loss_.resize(images.depth.size());
        parallel_for(Device{}, w * h,
                     DepthSmoothBody{w, h, images.depth.span(), images.transmittance.span(), order,
                                     prior_values(in.view, prior_map::kConfidence),
                                     1 / length_unit_, mean_of((w - 1) * h), mean_of(w * (h - 1)),
                                     pixel_loss_.span(), objective.dL_dimages.depth.span()});
        objective.add(pixel_loss_);
    }

private:
    ScheduledOptions options_;
    float length_unit_;
    Buffer<float, Device> pixel_loss_;
};

}  // namespace tvsgs
