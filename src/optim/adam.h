// Adam over the Gaussians' parameter groups.  [Kingma15], rates of 3DGS
#pragma once

#include <array>
#include <cmath>

#include "core/gaussians.h"
#include "core/options.h"
#include "core/parallel.h"
#include "core/state.h"

namespace tvsgs {

struct AdamOptions {
    float position_start = 1.6e-4f, position_end = 1.6e-6f;
    int position_max_steps = 30000;
    float sh_dc = 2.5e-3f, sh_rest = 1.25e-4f, opacity = 0.05f, scale = 0.005f, rotation = 0.001f;

    template <class Visitor>
    void fields(Visitor& field) {
        field("position_start", position_start, {0, 1},
              "rate of the means at the start, in scene extents");
        field("position_end", position_end, {0, 1},
              "the same at position_max_steps; geometric in between");
        field("position_max_steps", position_max_steps, {1, 1e9},
              "iterations over which the means' rate falls");
        field("sh_dc", sh_dc, {0, 1}, "rate of the base colour");
        field("sh_rest", sh_rest, {0, 1}, "rate of the higher spherical harmonics");
        field("opacity", opacity, {0, 10}, "rate of the opacity logits");
        field("scale", scale, {0, 1}, "rate of the log scales");
        field("rotation", rotation, {0, 1}, "rate of the quaternions");
    }
};

/// Parameters that share a learning rate, in the order of the kinds in Gaussians.
enum class ParameterGroup { means, scales, rotations, opacities, sh_dc, sh_rest };
inline constexpr int kParameterGroups = 6;

/// Rate of the means at an iteration, world units.
inline float position_rate(const AdamOptions& o, int step, float extent) {
    const double u = std::min(1.0, static_cast<double>(step) / o.position_max_steps);
    return static_cast<float>(extent * std::pow(static_cast<double>(o.position_start), 1 - u) *
                              std::pow(static_cast<double>(o.position_end), u));
}

/// One Adam step of one number; moments are updated in place, the new value is returned.
/// `correction1/2` = 1 - beta^t.
template <class Real>
TVSGS_HD Real adam_update(
    Real value, Real gradient, Real& m, Real& v, Real rate, Real correction1, Real correction2) {
    constexpr Real beta1 = Real(0.9), beta2 = Real(0.999), eps = Real(1e-15);
    m = beta1 * m + (1 - beta1) * gradient;
    v = beta2 * v + (1 - beta2) * gradient * gradient;
    return value - rate * (m / correction1) / (std::sqrt(v / correction2) + eps);
}

struct AdamBody {
    float *values, *m, *v;
    const float* gradients;
    float rate, correction1, correction2, least;  // values stay at or above `least`

    TVSGS_HD void operator()(int i) const {
        const float next =
            adam_update(values[i], gradients[i], m[i], v[i], rate, correction1, correction2);
        values[i] = next < least ? least : next;
    }
};
/// body(i) for i in [0, count), unless *halted, where that is given, is not 0.
void update_parameters(Cpu, int count, const AdamBody& body, const int* halted);
void update_parameters(Cuda, int count, const AdamBody& body, const int* halted);

template <class Device>
class Adam {
public:
    Adam(const AdamOptions& options, const Gaussians<Device>& gaussians) : options_(options) {
        resize(m_, gaussians.size(), gaussians.sh_degree);
        resize(v_, gaussians.size(), gaussians.sh_degree);
        fill_zero(m_);
        fill_zero(v_);
    }

    /// `step` sets the position rate; `sh_degree` is the degree in use: above it gradients and
    /// moments are zero. Where *halted (on the device; may be null) is not 0, nothing changes.
    void step(int step,
              float extent,
              int sh_degree,
              const Gaussians<Device>& gradients,
              Gaussians<Device>& g,
              bool with_opacity,
              const int* halted = nullptr) {
        using enum ParameterGroup;
        halted_ = halted;
        // Below this the smallest scale, which the flattening loss pushes to 0, would underflow.
        const float least_log_scale = -16.118096f;  // ln 1e-7
        ++count_;
        const float none = -INFINITY;  // a bound would hide what is not finite
        const auto rate = [this](ParameterGroup group, float given) {
            return given * rate_factors_[static_cast<std::size_t>(group)];
        };
        update(g.means, gradients.means, m_.means, v_.means,
               rate(means, position_rate(options_, step, extent)), none);
        update(g.log_scales, gradients.log_scales, m_.log_scales, v_.log_scales,
               rate(scales, options_.scale), least_log_scale);
        update(g.quats, gradients.quats, m_.quats, v_.quats, rate(rotations, options_.rotation),
               none);
        if (with_opacity)
            update(g.opacity_logits, gradients.opacity_logits, m_.opacity_logits, v_.opacity_logits,
                   rate(opacities, options_.opacity), none);
        const std::size_t n = g.means.size(), active = n * sh_count(sh_degree);
        update(g.sh, gradients.sh, m_.sh, v_.sh, rate(sh_dc, options_.sh_dc), none, 0, n);
        update(g.sh, gradients.sh, m_.sh, v_.sh, rate(sh_rest, options_.sh_rest), none, n, active);
    }

    /// From now on the group's rate is `factor` x what it would have been.
    void lower_rate(ParameterGroup group, float factor) {
        rate_factors_[static_cast<std::size_t>(group)] *= factor;
    }

    void state(StateVisitor<Device>& visit) {
        visit.value("adam.count", count_);
        visit.value("adam.rate_factors", rate_factors_);
        visit_state(visit, "adam.m.", m_);
        visit_state(visit, "adam.v.", v_);
    }

    Gaussians<Device>& first_moments() { return m_; }
    Gaussians<Device>& second_moments() { return v_; }

private:
    template <class T>
    void update(Buffer<T, Device>& values,
                const Buffer<T, Device>& gradients,
                Buffer<T, Device>& m,
                Buffer<T, Device>& v,
                float rate,
                float least,
                std::size_t begin = 0,
                std::size_t end = static_cast<std::size_t>(-1)) {
        if (end > values.size()) end = values.size();
        const double t = count_;
        const auto floats = [begin](auto* data) { return reinterpret_cast<float*>(data + begin); };
        const int count = static_cast<int>((end - begin) * (sizeof(T) / sizeof(float)));
        const AdamBody body{floats(values.data()),
                            floats(m.data()),
                            floats(v.data()),
                            reinterpret_cast<const float*>(gradients.data() + begin),
                            rate,
                            static_cast<float>(1 - std::pow(0.9, t)),
                            static_cast<float>(1 - std::pow(0.999, t)),
                            least};
        update_parameters(Device{}, count, body, halted_);
    }

    AdamOptions options_;
    Gaussians<Device> m_, v_;
    std::array<float, kParameterGroups> rate_factors_{1, 1, 1, 1, 1, 1};
    const int* halted_ = nullptr;
    int count_ = 0;
};

}  // namespace tvsgs
