// Loss: order of depth of two pixels, compared with a prior, for pairs within patches.
#pragma once

#include "optim/losses/depth_prior_math.h"
#include "optim/losses/loss.h"

namespace tvsgs {

/// One pair of pixels; no other pair contains them.
struct DepthRankBody {
    PatchGrid grid;
    int width;
    Random4 key;
    Span<const float> depth, transmittance, order, confidence;
    float per_length;  // length units of the losses per world unit
    float weight_per_pair;
    Span<float> pair_loss;  // overwritten
    Span<float> dL_ddepth;  // added to

    TVSGS_HD bool known(int at) const {
        return depth[at] > 0 && transmittance[at] <= 0.5f && order[at] - order[at] == 0 &&
               confidence_at(confidence, at) > 0;
    }

    TVSGS_HD void operator()(int i) const {
        pair_loss[i] = 0;
        const auto [a, b] = pixel_pair(grid, width, i, key);
        if (!known(a) || !known(b)) return;
        const auto pair = order_hinge(order_sign(order[a], order[b], 0.0f),
                                      per_length * (depth[b] - depth[a]), kOrderMargin);
        pair_loss[i] = weight_per_pair * pair.value;
        const float slope = weight_per_pair * per_length * pair.slope;
        dL_ddepth[a] -= slope;
        dL_ddepth[b] += slope;
    }
};

/// Half the mean over the pairs of one grid of patches plus half that of a grid half a patch off,
/// of [sgn(M_a - M_b) (D_b - D_a) + margin]+. Only the order of the prior M counts. Each iteration
/// draws a permutation per grid, which all its patches share. Pairs cost nothing if a pixel has no
/// depth, no prior, or a coverage below one half. [docs/method/fates.md#ranking]
template <class Device>
class DepthRankLoss final : public Loss<Device> {
public:
    explicit DepthRankLoss(const ScheduledOptions& options, const LossContext& context = {})
        : options_(options), length_unit_(context.length_unit), seed_(context.seed) {}

    LossNeeds needs() const override {
        return {.maps = Maps::depth, .view_maps = {prior_map::kDepthOrder, prior_map::kConfidence}};
    }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        const auto order = prior_values(in.view, prior_map::kDepthOrder);
        if (order.empty()) return;
        const auto& images = in.images;
        for (const int fewer : {0, 1}) {
            const PatchGrid grid = patch_grid(images.width, images.height, fewer);
            const int pairs = grid.pairs();
            if (pairs == 0) continue;
            pair_loss_.resize(pairs);
            parallel_for(Device{}, pairs,
                         DepthRankBody{grid, images.width,
                                       random4(seed_, RandomStream::depth_ranks,
                                               std::uint64_t(in.step), std::uint32_t(fewer)),
                                       images.depth.span(), images.transmittance.span(), order,
                                       prior_values(in.view, prior_map::kConfidence),
                                       1 / length_unit_, options_.weight / (2 * float(pairs)),
                                       pair_loss_.span(), objective.dL_dimages.depth.span()});
            objective.add(pair_loss_);
        }
    }

private:
    ScheduledOptions options_;
    float length_unit_;
    std::uint64_t seed_;
    Buffer<float, Device> pair_loss_;
};

}  // namespace tvsgs
