// Loss: the smallest scale of each visible splat.
#pragma once

#include "optim/losses/loss.h"
#include "render/ewa/projection_math.h"

namespace tvsgs {

struct SmallestScaleTerm {
    Span<const Vec3f> log_scales;
    Span<const float> radii_px;
    const double* count;  // number of visible splats
    TVSGS_HD double operator()(int i) const {
        if (!(radii_px[i] > 0)) return 0;
        const Vec3f s = log_scales[i];
        return std::exp(s[smallest_axis(s)]) / *count;
    }
};

struct FlattenGradientBody {
    SmallestScaleTerm term;
    float weight;
    Span<Vec3f> dL_dlog_scales;
    TVSGS_HD void operator()(int i) const {
        // s / count, which is also its derivative by log s.
        const float share = float(term(i));
        if (share > 0) dL_dlog_scales[i][smallest_axis(term.log_scales[i])] += weight * share;
    }
};

/// Mean smallest scale of the visible splats, world units.  [PGSR, Eq. 7]
template <class Device>
class FlattenLoss final : public Loss<Device> {
public:
    explicit FlattenLoss(const ScheduledOptions& options, const LossContext& context = {})
        : options_(options) {
        options_.weight /= context.length_unit;
    }

    LossNeeds needs() const override { return {.splat_gradients = true, .thickness = true}; }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        const int n = in.gaussians.size();
        objective.count_of(n, CountPositive{in.radii_px});
        const SmallestScaleTerm term{in.gaussians.log_scales.span(), in.radii_px,
                                     objective.count.data()};
        add_sum(Device{}, n, term, options_.weight, objective.partial.span(), objective.value());
        parallel_for(
            Device{}, n,
            FlattenGradientBody{term, options_.weight, objective.dL_dgaussians.log_scales.span()});
    }

private:
    ScheduledOptions options_;
};

}  // namespace tvsgs
