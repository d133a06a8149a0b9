// Adam optimiser over the Gaussians' parameter groups.  [Kingma15], rates of 3DGS
#pragma once

#include <array>
#include <cmath>

#include "core/device/parallel.h"
#include "core/options.h"
#include "core/scene/state.h"
#include "optim/optimiser/adam_step.h"

namespace tvsgs {

struct AdamOptions {
    float position_start = 1.6e-4f, position_end = 1.6e-6f;
    int position_max_steps = 30000;
    float sh_dc = 2.5e-3f, sh_rest = 1.25e-4f, opacity = 0.05f, scale = 0.005f, rotation = 0.001f;
    float supported = 0;

    template <class Visitor>
    void fields(Visitor& field) {
        field("position_start", position_start, {0, 1},
              "learning rate of the means at the start, in scene extents");
        field("position_end", position_end, {0, 1},
              "learning rate of the means at position_max_steps, with exponential decay between");
        field("position_max_steps", position_max_steps, {1, 1e9},
              "iterations over which the rate of the means falls");
        field("sh_dc", sh_dc, {0, 1}, "learning rate of the base colour");
        field("sh_rest", sh_rest, {0, 1}, "learning rate of the other SH coefficients");
        field("opacity", opacity, {0, 10}, "learning rate of the opacity logits");
        field("scale", scale, {0, 1}, "learning rate of the log scales");
        field("rotation", rotation, {0, 1}, "learning rate of the quaternions");
        field(
            "supported", supported, {0, 100},
            "factor of the learning rates of splats that stereo supports (init.support): 0.02 "
            "uncertainties for the means, with the decay of the others, 0.001 for the log scales, "
            "0.0005 for the quaternions; 0: learning rates of the others");
    }
};

/// Rates of supported splats at AdamOptions::supported = 1; of the means in uncertainties.
inline constexpr float kSupportedPosition = 0.02f, kSupportedScale = 1e-3f,
                       kSupportedRotation = 5e-4f;

/// Parameters that share a learning rate, in the order of the kinds in Gaussians.
enum class ParameterGroup { means, scales, rotations, opacities, sh_dc, sh_rest };
inline constexpr int kParameterGroups = 6;

/// Rate of the means at an iteration, world units.
inline float position_rate(const AdamOptions& o, int step, float extent) {
    const double u = std::min(1.0, double(step) / o.position_max_steps);
    return float(extent * std::pow(double(o.position_start), 1 - u) *
                 std::pow(double(o.position_end), u));
}

struct AdamBody {
    float *values, *m, *v;
    const float* gradients;
    AdamScale scale;
    float least;  // values stay at or above it
    SupportedRate supported{};
    int width = 1;  // numbers per splat

    TVSGS_HD void operator()(int i) const {
        const float rate = supported.of(i / width, scale.step);
        const float next = adam_update(values[i], gradients[i], m[i], v[i], rate, scale.root);
        values[i] = next < least ? least : next;
    }
};
/// Runs body(i) for i in [0, count), unless `halted` is not null and *halted is not 0.
void update_parameters(Cpu, int count, const AdamBody& body, const int* halted);
void update_parameters(Cuda, int count, const AdamBody& body, const int* halted);

/// Moments of all splats, and Adam's step. `sh_degree`: in use; higher coefficients have zero
/// gradients and moments. Where *halted (device memory; may be null) is not 0, a step changes
/// nothing.
template <class Device>
class Adam {
public:
    Adam(const AdamOptions& options, const Gaussians<Device>& gaussians) : options_(options) {
        resize(m_, gaussians.size(), gaussians.sh_degree);
        resize(v_, gaussians.size(), gaussians.sh_degree);
        fill_zero(m_);
        fill_zero(v_);
    }

    /// Takes a step along gradients in memory.
    void step(int step,
              float extent,
              int sh_degree,
              const Gaussians<Device>& gradients,
              Gaussians<Device>& g,
              bool with_opacity,
              const int* halted = nullptr) {
        using enum ParameterGroup;
        begin_step(step, extent);
        const SupportedScale own = supported(step, g);
        const auto update = [&](ParameterGroup group, auto& values, const auto& dL, auto& m,
                                auto& v, const SupportedRate& rate = {}) {
            update_group(group, 0, values.size(), values, dL, m, v, halted, rate);
        };
        update(means, g.means, gradients.means, m_.means, v_.means, own.mean);
        update(scales, g.log_scales, gradients.log_scales, m_.log_scales, v_.log_scales,
               own.log_scale);
        update(rotations, g.quats, gradients.quats, m_.quats, v_.quats, own.quat);
        if (with_opacity)
            update(opacities, g.opacity_logits, gradients.opacity_logits, m_.opacity_logits,
                   v_.opacity_logits);
        const std::size_t n = g.means.size(), used = n * std::size_t(sh_count(sh_degree));
        update_group(sh_dc, 0, n, g.sh, gradients.sh, m_.sh, v_.sh, halted);
        update_group(sh_rest, n, used, g.sh, gradients.sh, m_.sh, v_.sh, halted);
    }

    /// Takes a step along the rasteriser's sums over pixels and the gradients that losses add to
    /// the geometry (`extra`; may be empty). The gradients of parameters never lie in memory.
    void step(int step,
              float extent,
              int sh_degree,
              const FusedGradients& gradients,
              Gaussians<Device>& extra,
              Gaussians<Device>& g,
              bool with_opacity,
              const int* halted = nullptr) {
        using enum ParameterGroup;
        begin_step(step, extent);
        take_step(Device{}, g.size(), gradients,
                  {geometry_spans(g),
                   geometry_spans(m_),
                   geometry_spans(v_),
                   geometry_spans(extra),
                   {g.sh.data(), m_.sh.data(), v_.sh.data(), g.means.size(), sh_count(sh_degree)},
                   {rate(means), rate(scales), rate(rotations), rate(opacities), root_},
                   {rate(sh_dc), rate(sh_rest), root_},
                   supported(step, g),
                   with_opacity,
                   halted});
    }

    /// Multiplies the group's rate by `factor` from now on.
    void lower_rate(ParameterGroup group, float factor) { rate_factors_[int(group)] *= factor; }

    void state(StateVisitor<Device>& visit) {
        visit.value("adam.count", count_);
        visit.value("adam.rate_factors", rate_factors_);
        visit_state(visit, "adam.m.", m_);
        visit_state(visit, "adam.v.", v_);
    }

    Gaussians<Device>& first_moments() { return m_; }
    Gaussians<Device>& second_moments() { return v_; }

private:
    /// Steps elements [begin, end) of one parameter.
    template <class T>
    void update_group(ParameterGroup group,
                      std::size_t begin,
                      std::size_t end,
                      Buffer<T, Device>& values,
                      const Buffer<T, Device>& dL,
                      Buffer<T, Device>& m,
                      Buffer<T, Device>& v,
                      const int* halted,
                      const SupportedRate& supported = {}) {
        const auto floats = [&](auto* data) {
            using Float = std::conditional_t<std::is_const_v<std::remove_pointer_t<decltype(data)>>,
                                             const float, float>;
            return reinterpret_cast<Float*>(data + begin);
        };
        // Only scales have a bound; in other groups it would hide infinite values.
        const float least = group == ParameterGroup::scales ? kLeastLogScale : -INFINITY;
        const std::size_t count = (end - begin) * sizeof(T) / sizeof(float);
        update_parameters(Device{}, int(count),
                          {floats(values.data()),
                           floats(m.data()),
                           floats(v.data()),
                           floats(dL.data()),
                           {rate(group), root_},
                           least,
                           supported,
                           int(sizeof(T) / sizeof(float))},
                          halted);
    }

    void begin_step(int step, float extent) {
        position_rate_ = position_rate(options_, step, extent);
        root_ = adam_scale(1, ++count_).root;
    }

    /// The rates of splats that stereo supports; none if they have the rates of the others.
    SupportedScale supported(int step, const Gaussians<Device>& g) const {
        using enum ParameterGroup;
        if (!(options_.supported > 0) || g.uncertainty.empty()) return {};
        const auto scaled = [&](float own, ParameterGroup group) {
            const float factor = rate_factors_[int(group)];
            return adam_scale(options_.supported * own * factor, count_).step;
        };
        // A rate of 0 of the others holds them still and has no decay.
        const float first = options_.position_start,
                    fall = first > 0 ? position_rate(options_, step, 1) / first : 1;
        const Span<const float> u = g.uncertainty.span();
        return {{u, scaled(kSupportedPosition * fall, means), true},
                {u, scaled(kSupportedScale, scales)},
                {u, scaled(kSupportedRotation, rotations)}};
    }

    /// Rate of the current step with its bias correction.
    float rate(ParameterGroup group) const {
        const float rates[] = {position_rate_,   options_.scale, options_.rotation,
                               options_.opacity, options_.sh_dc, options_.sh_rest};
        const auto i = std::size_t(group);
        return adam_scale(rates[i] * rate_factors_[i], count_).step;
    }

    AdamOptions options_;
    Gaussians<Device> m_, v_;
    std::array<float, kParameterGroups> rate_factors_{1, 1, 1, 1, 1, 1};
    int count_ = 0;
    float position_rate_ = 0, root_ = 1;  // of the current step
};

}  // namespace tvsgs
