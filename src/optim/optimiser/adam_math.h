// Adam's step of a single number and of the SH coefficients of one Gaussian.  [Kingma15]
#pragma once

#include "core/math/fast_math.h"
#include "render/tiles/sh_math.h"

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
/// produce the same bits: multiply_add() leaves the compiler no choice to fuse operations.
template <class Real>
TVSGS_HD Real adam_update(Real value, Real gradient, Real& m, Real& v, Real step, Real root) {
    // 1 - beta as a literal: in float, 1 - 0.999f is off by 1.3e-5 of itself.
    constexpr Real kShare1 = Real(0.1), kShare2 = Real(0.001);
    m = multiply_add(Real(kAdamBeta1), m, kShare1 * gradient);
    v = multiply_add(kShare2, multiply_add(gradient, gradient, -v), v);
    return value - step * m / multiply_add(root, std::sqrt(v), Real(kAdamEps));
}

/// Rates of the SH coefficients with bias correction; the base colour has its own.
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

}  // namespace tvsgs
