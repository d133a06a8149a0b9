// The last part of an iteration in one pass: from the gradients of a view's splats on the image to
// the Gaussians' new parameters. No gradient of a parameter goes through memory.
#pragma once

#include "optim/adam_math.h"
#include "render/view_splats.h"

namespace tvsgs {

/// How Adam treats what a view does not see.
enum class AdamForm {
    dense,   // all parameters of all Gaussians step
    lazy,    // the same, bit for bit; the harmonics' steps wait until they are read
    visible  // only Gaussians in view step
};

/// Arrays of one Gaussians object but its colours; null: there are none.
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

// Below this the smallest scale, which the flattening loss pushes to 0, would underflow.
inline constexpr float kLeastLogScale = -16.118096f;  // ln 1e-7

/// One step of a Gaussian's geometry, its moments included.
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
        // Written so that what is not finite shows.
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

struct AdamStep {
    ViewGradients view;
    GeometrySpans values, m, v;
    GeometrySpans extra;  // gradients that losses give without the image; may be null
    ShAdam sh;
    AdamForm form;
    GeometryScale geometry_scale;
    ShScale sh_scale;
    bool with_opacity;
    const int* halted;  // where *halted (may be null) is not 0, nothing changes
};

/// `kGroup`: coefficients of the harmonics at a time.
template <Channels kChannels, int kGroup>
struct AdamStepBody {
    AdamStep in;

    TVSGS_HD void operator()(int i) const {
        if (in.halted != nullptr && *in.halted != 0) return;
        SplatGeometry splat = in.values.load(i), gradient = no_gradient();
        ShStep<kGroup> sh{in.sh, i, in.sh_scale};
        const bool drawn = splat_vjp<kChannels>(in.view, i, splat, gradient, sh);
        const bool in_view = in.view.slot_counts[i] != 0;
        const bool colored = drawn && has_color(kChannels);
        if (in.form == AdamForm::lazy) {
            if (colored && in.sh.taken != nullptr)
                in.sh.taken[i] = static_cast<std::uint8_t>(in.sh.due + 1);
        } else if (!colored && (in.form == AdamForm::dense || in_view)) {
            sh.decay();
        }
        if (in.form == AdamForm::visible && !in_view) return;
        if (in.extra.means != nullptr) add(gradient, in.extra.load(i));
        SplatGeometry m = in.m.load(i), v = in.v.load(i);
        step_geometry(splat, gradient, m, v, in.geometry_scale, in.with_opacity);
        in.values.store(i, splat), in.m.store(i, m), in.v.store(i, v);
    }
};

/// Harmonics of the Gaussians with a radius, or of all where there are no radii.
template <int kGroup>
struct CatchUpBody {
    ShAdam sh;
    Span<const float> radii_px;

    TVSGS_HD void operator()(int i) const {
        if (radii_px.empty() || radii_px[i] > 0) sh.catch_up<kGroup>(i);
    }
};

void take_step(Cpu, int count, const AdamStep& step);
void take_step(Cuda, int count, const AdamStep& step);
void catch_up(Cpu, int count, const ShAdam& sh, Span<const float> radii_px);
void catch_up(Cuda, int count, const ShAdam& sh, Span<const float> radii_px);

/// run(body) with the body for the view's channels. The twins differ in how many harmonics they
/// hold at once.
template <int kGroup, class Run>
void with_step_body(const AdamStep& step, const Run& run) {
    switch (step.view.channels) {
        case Channels::color:
            return run(AdamStepBody<Channels::color, kGroup>{step});
        case Channels::color_plane:
            return run(AdamStepBody<Channels::color_plane, kGroup>{step});
        case Channels::plane:
            return run(AdamStepBody<Channels::plane, kGroup>{step});
    }
}

}  // namespace tvsgs
