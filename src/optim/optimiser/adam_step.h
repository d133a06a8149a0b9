// Adam's step of one number, of the SH coefficients of one Gaussian, and of all its parameters.
// [Kingma15] One pass computes the new parameters from the image gradients of a view's splats; it
// never stores the gradients of parameters in memory.
#pragma once

#include "core/math/fast_math.h"
#include "render/backbone.h"
#include "render/tiles/sh_math.h"
#include "render/tiles/splat_vjp.h"

namespace tvsgs {

/// Bias corrections of step t, folded into the rate and the root of the second moment.
struct AdamScale {
    float step;  // rate / (1 - beta1^t)
    float root;  // 1 / sqrt(1 - beta2^t)
};

inline constexpr double kAdamBeta1 = 0.9, kAdamBeta2 = 0.999, kAdamEps = 1e-15;

/// Bias corrections of step t; t counts from 1.
inline AdamScale adam_scale(float rate, int t) {
    return {float(double(rate) / (1 - std::pow(kAdamBeta1, t))),
            float(1 / std::sqrt(1 - std::pow(kAdamBeta2, t)))};
}

/// One Adam step of one number; updates the moments in place and returns the new value. All kernels
/// produce the same bits, because multiply_add() decides which operations are fused.
template <class Real>
TVSGS_HD Real adam_update(Real value, Real gradient, Real& m, Real& v, Real step, Real root) {
    // 1 - beta as a literal: in float, 1 - 0.999f has a relative error of 1.3e-5.
    constexpr Real kShare1 = Real(0.1), kShare2 = Real(0.001);
    m = multiply_add(Real(kAdamBeta1), m, kShare1 * gradient);
    v = multiply_add(kShare2, multiply_add(gradient, gradient, -v), v);
    return value - step * m / multiply_add(root, std::sqrt(v), Real(kAdamEps));
}

/// Rates of the SH coefficients with bias correction; the base colour has its own rate.
struct ShScale {
    float step_dc, step_rest, root;
};

/// SH coefficients and their moments, coefficient major as in Gaussians::sh.
struct ShAdam {
    Vec3f *values, *m, *v;
    std::size_t stride;  // Gaussians
    int coefficients;    // in use

    /// `kGroup` coefficients of Gaussian i, RGB side by side; absent ones count as 0.
    template <int kGroup>
    struct Group {
        float value[3 * kGroup], m[3 * kGroup], v[3 * kGroup];
    };
    template <int kGroup>
    TVSGS_HD Group<kGroup> load(int i, int first) const {
        Group<kGroup> g;
        const auto get = [&](const Vec3f* from, int k, float* to) {
            const bool there = first + k < coefficients;
            const Vec3f c = there ? from[std::size_t(first + k) * stride + i] : Vec3f{};
            to[3 * k] = c.x, to[3 * k + 1] = c.y, to[3 * k + 2] = c.z;
        };
        for (int k = 0; k < kGroup; ++k) get(values, k, g.value), get(m, k, g.m), get(v, k, g.v);
        return g;
    }
    template <int kGroup>
    TVSGS_HD void store(int i, int first, const Group<kGroup>& g) const {
        const auto put = [&](const float* from, int k, Vec3f* to) {
            to[std::size_t(first + k) * stride + i] = {from[3 * k], from[3 * k + 1],
                                                       from[3 * k + 2]};
        };
        for (int k = 0; k < kGroup; ++k) {
            if (first + k >= coefficients) break;
            put(g.value, k, values), put(g.m, k, m), put(g.v, k, v);
        }
    }
    template <int kGroup>
    TVSGS_HD static void step(Group<kGroup>& g,
                              int first,
                              const float (&dL)[3 * kGroup],
                              const ShScale& s) {
        for (int j = 0; j < 3 * kGroup; ++j)
            g.value[j] = adam_update(g.value[j], dL[j], g.m[j], g.v[j],
                                     3 * first + j < 3 ? s.step_dc : s.step_rest, s.root);
    }
};

/// Takes the SH step of Gaussian `at` inside sh_color_vjp, which computes its gradients.
template <int kGroup_>
struct ShStep {
    static constexpr int kGroup = kGroup_;
    const ShAdam& sh;
    int at;
    ShScale scale;

    TVSGS_HD void operator()(int first,
                             const Vec3f (&gradient)[kGroup],
                             Vec3f (&values)[kGroup]) const {
        auto g = sh.load<kGroup>(at, first);
        float dL[3 * kGroup];
        for (int k = 0; k < kGroup; ++k) {
            values[k] = {g.value[3 * k], g.value[3 * k + 1], g.value[3 * k + 2]};
            dL[3 * k] = gradient[k].x, dL[3 * k + 1] = gradient[k].y, dL[3 * k + 2] = gradient[k].z;
        }
        ShAdam::step<kGroup>(g, first, dL, scale);
        sh.store(at, first, g);
    }

    /// Takes a step with gradients of zero.
    TVSGS_HD void decay() const {
        const Vec3f zero[kGroup]{};
        Vec3f values[kGroup];
        for (int first = 0; first < sh.coefficients; first += kGroup) (*this)(first, zero, values);
    }
};

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
        // This comparison keeps NaN.
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
    Span<const float> uncertainty{};  // [N]; empty: stereo supports no splat
    float rate = 0;
    bool in_uncertainties = false;  // the rate is per unit of the splat's uncertainty

    TVSGS_HD float of(int i, float others) const {
        if (!is_supported(uncertainty, i)) return others;
        return in_uncertainties ? rate * uncertainty[i] : rate;
    }
};

/// The SupportedRate of each parameter that has one.
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
    const int* halted;  // device memory, may be null; if *halted is not 0, nothing changes
};

/// Steps the geometry of Gaussian i and passes its SH gradients to `visit`, see sh_color_vjp.
/// Returns true if it has none; the caller then takes the SH step with gradients of zero.
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
