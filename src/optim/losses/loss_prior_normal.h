// Loss: normals of the depth map against the normals of a prior.
#pragma once

#include "optim/losses/depth_normals.h"
#include "optim/losses/loss.h"

namespace tvsgs {

struct PriorNormalOptions : ScheduledOptions {
    bool by_confidence = true;

    template <class Visitor>
    void fields(Visitor& field) {
        ScheduledOptions::fields(field);
        field("by_confidence", by_confidence,
              "weight pixels by the confidence of the prior; false: equal weights above 0");
    }
};

/// weight * c A (1 - N . n): c the prior's confidence, A the coverage; 0 where depth or prior have
/// no normal.
struct PriorNormalBody {
    Camera camera;
    Span<const float> depth, transmittance, prior, confidence;
    bool by_confidence;
    float weight_per_pixel;
    Span<float> pixel_loss;                        // overwritten
    Span<DepthNormalGradients<float>> neighbours;  // overwritten

    TVSGS_HD void operator()(int at) const {
        pixel_loss[at] = 0;
        neighbours[at] = {};
        const Vec3f wanted{prior[3 * at], prior[3 * at + 1], prior[3 * at + 2]};
        const float sure = confidence_at(confidence, at);
        DepthNormal<float> n;
        if (!(dot(wanted, wanted) > 0) || !is_finite(wanted) || !(sure > 0)) return;
        if (!depth_normal_at(camera, depth, at, n)) return;
        // A constant of the loss.
        const float share = weight_per_pixel * (1 - transmittance[at]) * (by_confidence ? sure : 1);
        pixel_loss[at] = share * (1 - dot(n.normal, wanted));
        neighbours[at] = depth_normal_vjp(n, -share * wanted);
    }
};

/// mean over pixels of c A (1 - N . n), N the normals of the depth map, n the prior's, both in the
/// camera's frame. Pixels without N or n add nothing.  [docs/method/vggs.md#normals]
template <class Device>
class PriorNormalLoss final : public Loss<Device> {
public:
    explicit PriorNormalLoss(const PriorNormalOptions& options, const LossContext& = {})
        : options_(options) {}

    LossNeeds needs() const override {
        return {.maps = Maps::depth, .view_maps = {prior_map::kNormal, prior_map::kConfidence}};
    }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        const Span<const float> prior = prior_values(in.view, prior_map::kNormal, 3);
        if (prior.empty()) return;
        const auto& images = in.images;
        const int pixels = int(images.depth.size());
        pixel_loss_.resize(images.depth.size());
        neighbours_.resize(images.depth.size());
        parallel_for(Device{}, pixels,
                     PriorNormalBody{
                         images.camera, images.depth.span(), images.transmittance.span(), prior,
                         prior_values(in.view, prior_map::kConfidence), options_.by_confidence,
                         options_.weight / float(pixels), pixel_loss_.span(), neighbours_.span()});
        objective.add(pixel_loss_);
        parallel_for(Device{}, pixels,
                     NormalDepthBody{images.camera, neighbours_.span(), images.depth.span(),
                                     objective.dL_dimages.depth.span()});
    }

private:
    PriorNormalOptions options_;
    Buffer<float, Device> pixel_loss_;
    Buffer<DepthNormalGradients<float>, Device> neighbours_;
};

}  // namespace tvsgs
