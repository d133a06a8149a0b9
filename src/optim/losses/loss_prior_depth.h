// Loss: depth against a prior in world units.
#pragma once

#include "optim/losses/depth_prior_math.h"
#include "optim/losses/loss.h"

namespace tvsgs {

struct PriorDepthOptions : ScheduledOptions {
    float last_share = 1;
    int end = 0;

    template <class Visitor>
    void fields(Visitor& field) {
        ScheduledOptions::fields(field);
        field("end", end, {0, 1e9}, "last iteration; 0: never ends");
        field("last_share", last_share, {1e-6, 1},
              "share of the weight at the last iteration, by exponential decay; 1: no decay");
    }
    template <class Options, class Visit>
    static void first_iterations(Options& o, const Visit& visit) {
        ScheduledOptions::first_iterations(o, visit);
        visit("end", o.end);
    }
};

struct PriorDepthBody {
    // Huber threshold of the relative error: about the error of stereo depth.
    static constexpr float kSoftness = 0.01f;

    Span<const float> depth, prior, confidence;
    float weight_per_pixel;
    Span<float> pixel_loss;  // overwritten
    Span<float> dL_ddepth;   // added to

    TVSGS_HD void operator()(int at) const {
        pixel_loss[at] = 0;
        const float share = weight_per_pixel * confidence_at(confidence, at);
        if (!(share > 0) || !(depth[at] > 0) || !(prior[at] > 0) || !is_number(prior[at])) return;
        const Penalty<float> p = relative_huber(depth[at], prior[at], kSoftness);
        pixel_loss[at] = share * p.value;
        dL_ddepth[at] += share * p.slope;
    }
};

/// mean over pixels of c rho((D - M) / M), c the confidence of the prior M, rho Huber's function.
/// Errors are relative, so they have no unit. The weight falls from `start` to `end`: agreement of
/// several views overrides a prior that contradicts it.  [docs/method/vggs.md#metric-depth]
template <class Device>
class PriorDepthLoss final : public Loss<Device> {
public:
    explicit PriorDepthLoss(const PriorDepthOptions& options, const LossContext& = {})
        : options_(options) {}

    bool active(int step) const override {
        return step >= options_.start && (options_.end == 0 || step <= options_.end);
    }
    LossNeeds needs() const override {
        return {.maps = Maps::depth, .view_maps = {prior_map::kDepth, prior_map::kConfidence}};
    }

    /// weight * last_share^((step - start) / (end - start)).
    float weight_at(int step) const {
        if (options_.end <= options_.start) return options_.weight;
        const float done = float(step - options_.start) / float(options_.end - options_.start);
        return options_.weight * std::pow(options_.last_share, done);
    }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        const Span<const float> prior = prior_values(in.view, prior_map::kDepth);
        if (prior.empty()) return;
        const Buffer<float, Device>& depth = in.images.depth;
        const int pixels = int(depth.size());
        pixel_loss_.resize(depth.size());
        parallel_for(
            Device{}, pixels,
            PriorDepthBody{depth.span(), prior, prior_values(in.view, prior_map::kConfidence),
                           weight_at(in.step) / float(pixels), pixel_loss_.span(),
                           objective.dL_dimages.depth.span()});
        objective.add(pixel_loss_);
    }

private:
    PriorDepthOptions options_;
    Buffer<float, Device> pixel_loss_;
};

}  // namespace tvsgs
