// Losses: splats against the votes that they received.  [TV-SGS], docs/method/voting.md
#pragma once

#include "optim/losses/loss.h"
#include "render/ewa/projection_math.h"

namespace tvsgs {

/// 1 for a splat that the term includes.
struct TakesPart {
    Span<const std::uint8_t> flags;
    std::uint8_t flag;
    Span<const float> radii_px;
    bool visible_only;

    TVSGS_HD bool test(int i) const {
        return (flags[i] & flag) && (!visible_only || radii_px[i] > 0);
    }
    TVSGS_HD float operator()(int i) const { return test(i) ? 1.0f : 0.0f; }
};

/// Divisor of the reduction `sum`.
struct ConstantOne {
    TVSGS_HD float operator()(int) const { return 1; }
};

/// The splat's normal and the voted one; the axis index carries no gradient.
struct NormalAgreement {
    Span<const Vec3f> log_scales, voted;
    Span<const Quatf> quats;

    TVSGS_HD float operator()(int i) const {
        return dot(column(rotation(normalize(quats[i])), smallest_axis(log_scales[i])), voted[i]);
    }
};

struct TvNormalBody {
    TakesPart part;
    NormalAgreement agreement;
    const double* count;  // divisor of the reduction
    float weight;
    Span<float> splat_loss;
    Span<Quatf> dL_dquats;

    TVSGS_HD void operator()(int i) const {
        splat_loss[i] = 0;
        if (!part.test(i)) return;
        const float w = weight / float(*count), cosine = agreement(i);
        splat_loss[i] = w * (1 - std::abs(cosine));
        const int axis = smallest_axis(agreement.log_scales[i]);
        const Vec3f g = (cosine > 0 ? -w : cosine < 0 ? w : 0.0f) * agreement.voted[i];
        Mat3f dL_dR{};
        for (int row = 0; row < 3; ++row) dL_dR[row][axis] = g[row];
        const Quatf dq = rotation_vjp(agreement.quats[i], dL_dR);
        dL_dquats[i].w += dq.w, dL_dquats[i].x += dq.x, dL_dquats[i].y += dq.y,
            dL_dquats[i].z += dq.z;
    }
};

struct TvPositionBody {
    TakesPart part;
    Span<const Vec3f> means, targets;
    const double* count;
    float weight;
    Span<float> splat_loss;
    Span<Vec3f> dL_dmeans;

    TVSGS_HD void operator()(int i) const {
        splat_loss[i] = 0;
        if (!part.test(i)) return;
        const float w = weight / float(*count);
        for (int c = 0; c < 3; ++c) {
            const float d = means[i][c] - targets[i][c];
            splat_loss[i] += w * std::abs(d);
            dL_dmeans[i][c] += d > 0 ? w : d < 0 ? -w : 0;
        }
    }
};

/// Normal: reduce (1 - |n . n_tv|), with derivatives by the quaternions only. Position: reduce
/// |mean - p_tv|_1, with derivatives by the means only.
template <class Device, bool kPosition>
class TvLoss final : public Loss<Device> {
public:
    explicit TvLoss(const ScheduledOptions& options, const LossContext& context = {})
        : options_(options), reduction_(context.shared.tv_reduction) {
        if constexpr (kPosition) options_.weight /= context.length_unit;
    }

    LossNeeds needs() const override { return {.targets = kPosition, .splat_gradients = true}; }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        const int n = in.gaussians.size();
        if (int(in.field.flags.size()) != n) return;  // no voting event yet
        const TakesPart part{in.field.flags.span(), kPosition ? kPositionValid : kNormalValid,
                             in.radii_px, reduction_ == Reduction::visible_mean};
        if (reduction_ == Reduction::sum)
            objective.count_of(1, ConstantOne{});
        else
            objective.count_of(n, part);
        splat_loss_.resize(in.gaussians.means.size());
        if constexpr (kPosition)
            parallel_for(Device{}, n,
                         TvPositionBody{part, in.gaussians.means.span(), in.field.targets.span(),
                                        objective.count.data(), options_.weight, splat_loss_.span(),
                                        objective.dL_dgaussians.means.span()});
        else
            parallel_for(Device{}, n,
                         TvNormalBody{part,
                                      {in.gaussians.log_scales.span(), in.field.normals.span(),
                                       in.gaussians.quats.span()},
                                      objective.count.data(),
                                      options_.weight,
                                      splat_loss_.span(),
                                      objective.dL_dgaussians.quats.span()});
        objective.add(splat_loss_);
    }

private:
    ScheduledOptions options_;
    Reduction reduction_;
    Buffer<float, Device> splat_loss_;
};

template <class Device>
using TvNormalLoss = TvLoss<Device, false>;
template <class Device>
using TvPositionLoss = TvLoss<Device, true>;

}  // namespace tvsgs
