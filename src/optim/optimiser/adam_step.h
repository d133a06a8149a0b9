// From the image gradients of a view's splats to the Gaussians' new parameters in one pass: the
// gradients of parameters never go through memory.
#pragma once

#include "optim/optimiser/adam_math.h"
#include "render/backbone.h"
#include "render/tiles/splat_vjp.h"

namespace tvsgs {

/// Arrays of a Gaussians object without SH coefficients; null pointers: no arrays.
struct GeometrySpans {
    Vec3f *means = nullptr, *log_scales = nullptr;
    Quatf* quats = nullptr;
    float* opacity_logits = nullptr;

    TVSGS_HD SplatGeometry load(int i) const {
        return {means[i], log_scales[i], quats[i], opacity_logits[i]};
    }
    TVSGS_HD void store(int i, const SplatGeometry& g) const {
        means[i] = g.mean, log_scales[i] = g.log_scale;
        quats[i] = g.quat, opacity_logits[i] = g.opacity_logit;
    }
};
template <class Device>
GeometrySpans geometry_spans(Gaussians<Device>& g) {
    return {g.means.data(), g.log_scales.data(), g.quats.data(), g.opacity_logits.data()};
}

/// Rates with bias correction, as AdamScale::step.
struct GeometryScale {
    float mean, log_scale, quat, opacity_logit, root;
};

// A smaller scale would underflow; the flattening loss drives the smallest scale to 0.
inline constexpr float kLeastLogScale = -16.118096f;  // ln 1e-7

TVSGS_HD inline void step_geometry(SplatGeometry& splat,
                                   const SplatGeometry& gradient,
                                   SplatGeometry& m,
                                   SplatGeometry& v,
                                   const GeometryScale& scale,
                                   bool with_opacity) {
    const auto step = [&scale](float& value, float dL, float& moment, float& second, float rate) {
        value = adam_update(value, dL, moment, second, rate, scale.root);
    };
    for (int k = 0; k < 3; ++k) {
        step(splat.mean[k], gradient.mean[k], m.mean[k], v.mean[k], scale.mean);
        float& log_scale = splat.log_scale[k];
        step(log_scale, gradient.log_scale[k], m.log_scale[k], v.log_scale[k], scale.log_scale);
        // Written so that NaN is kept.
        log_scale = log_scale < kLeastLogScale ? kLeastLogScale : log_scale;
    }
    step(splat.quat.w, gradient.quat.w, m.quat.w, v.quat.w, scale.quat);
    step(splat.quat.x, gradient.quat.x, m.quat.x, v.quat.x, scale.quat);
    step(splat.quat.y, gradient.quat.y, m.quat.y, v.quat.y, scale.quat);
    step(splat.quat.z, gradient.quat.z, m.quat.z, v.quat.z, scale.quat);
    if (with_opacity)
        step(splat.opacity_logit, gradient.opacity_logit, m.opacity_logit, v.opacity_logit,
             scale.opacity_logit);
}

/// Rate of one parameter for splats that stereo supports.
struct SupportedRate {
    Span<const float> uncertainty{};  // [N]; empty: all splats have the others' rate
    float rate = 0;
    bool in_uncertainties = false;  // the rate is per unit of the splat's uncertainty

    TVSGS_HD float of(int i, float others) const {
        if (!is_supported(uncertainty, i)) return others;
        return in_uncertainties ? rate * uncertainty[i] : rate;
    }
};

/// The same of all parameters that have one.
struct SupportedScale {
    SupportedRate mean{}, log_scale{}, quat{};

    TVSGS_HD GeometryScale of(int i, GeometryScale scale) const {
        scale.mean = mean.of(i, scale.mean);
        scale.log_scale = log_scale.of(i, scale.log_scale);
        scale.quat = quat.of(i, scale.quat);
        return scale;
    }
};

struct AdamStep {
    GeometrySpans values, m, v;
    GeometrySpans extra;  // gradients of losses that do not use the image; may be null
    ShAdam sh;
    GeometryScale geometry_scale;
    ShScale sh_scale;
    SupportedScale supported;
    bool with_opacity;
    const int* halted;  // device memory; where *halted (may be null) is not 0, nothing changes
};

/// Steps the geometry of Gaussian i and passes its SH gradients to `visit`, see sh_color_vjp.
/// Returns true where it has none; the caller then takes the SH step with gradients of zero.
template <SplatVjp Vjp, class Visit>
TVSGS_HD bool step_splat(const Vjp& vjp, const AdamStep& in, int i, Visit& visit) {
    SplatGeometry splat = in.values.load(i), gradient = no_gradient();
    const bool colored = vjp(i, splat, gradient, visit) && Vjp::kColor;
    if (in.extra.means != nullptr) add(gradient, in.extra.load(i));
    SplatGeometry m = in.m.load(i), v = in.v.load(i);
    step_geometry(splat, gradient, m, v, in.supported.of(i, in.geometry_scale), in.with_opacity);
    in.values.store(i, splat), in.m.store(i, m), in.v.store(i, v);
    return !colored;
}

// The order of the SH steps differs: a GPU lane steps all coefficients of its Gaussian; a CPU
// thread steps one coefficient of 64 Gaussians after the other.
void take_step(Cpu, int count, const FusedGradients& gradients, const AdamStep& step);
void take_step(Cuda, int count, const FusedGradients& gradients, const AdamStep& step);

}  // namespace tvsgs
