// Fits a gain and an offset per photograph, for cameras and lights that change between photographs.
// [docs/method/pgsr.md#exposure]
#pragma once

#include "core/device/parallel.h"
#include "core/error.h"
#include "optim/losses/loss.h"
#include "optim/photo/photo_background.h"
#include "render/photometric/photometric.h"

namespace tvsgs {

/// The render and the photograph as the photometric terms compare them.
struct ComparedPhoto {
    Span<const Vec3f> color;         // [H W] the render
    Span<const std::uint8_t> photo;  // [H W 3]
    Span<Vec3f> dL_dcolor;           // [H W] added to
    Span<const float> mask;          // [H W] of the view; empty: all pixels are inside
};

/// e^A c + B of a rendered colour c; `values`: A and B.
template <class Real>
TVSGS_HD Vec3<Real> exposed(const Real* values, Vec3<Real> c) {
    const Real gain = std::exp(values[0]), offset = values[1];
    Vec3<Real> out;
    for (int k = 0; k < 3; ++k) out[k] = gain * c[k] + offset;
    return out;
}

template <class Real>
struct ExposedVjp {
    Vec3<Real> dL_dcolor;
    Real dL_dvalues[kExposureValues];
};
template <class Real>
TVSGS_HD ExposedVjp<Real> exposed_vjp(const Real* values, Vec3<Real> c, Vec3<Real> dL_dexposed) {
    const Real gain = std::exp(values[0]);
    ExposedVjp<Real> out{};
    for (int k = 0; k < 3; ++k) {
        const Real g = dL_dexposed[k];
        out.dL_dvalues[0] += g * (gain * c[k]);
        out.dL_dvalues[1] += g;
        out.dL_dcolor[k] += g * gain;
    }
    return out;
}

struct ExposureState {
    float value[kExposureValues];
    float m[kExposureValues], v[kExposureValues];
    int steps;
};

/// Exposure is applied only where a render resembles its photograph: SSIM loss below `limit`.
struct ExposureGate {
    const double* ssim_loss;
    double limit;
    TVSGS_HD bool open() const { return *ssim_loss < limit; }
};

/// The L1 term of one pixel, and its derivative by the exposure of the photograph.
struct ExposureL1Body {
    ComparedPhoto compared;
    const ExposureState* exposure;
    ExposureGate gate;
    float weight_per_value;
    Span<float> pixel_loss;  // added to
    Span<float> dL_dvalues;  // [kExposureValues H W] overwritten

    TVSGS_HD void operator()(int i) const {
        // Pixels that a mask replaced have no exposure.
        const bool on = gate.open() && (compared.mask.empty() || is_inside(compared.mask[i]));
        const Vec3f photo_i = detail::photo_pixel(compared.photo.data, std::size_t(i)),
                    color = compared.color[i], shown = on ? exposed(exposure->value, color) : color;
        Vec3f g;
        float loss = 0;
        for (int c = 0; c < 3; ++c) {
            const float d = shown[c] - photo_i[c];
            g[c] = d > 0 ? weight_per_value : d < 0 ? -weight_per_value : 0;
            loss += g[c] * d;
        }
        pixel_loss[i] += loss;
        ExposedVjp<float> vjp{g, {}};
        if (on) vjp = exposed_vjp(exposure->value, color, g);
        compared.dL_dcolor[i] += vjp.dL_dcolor;
        const std::size_t pixels = compared.color.size();
        for (int k = 0; k < kExposureValues; ++k)
            dL_dvalues[std::size_t(k) * pixels + std::size_t(i)] = vjp.dL_dvalues[k];
    }
};

/// Writes after the gradient whether exposures take a step.
struct ExposureOpenBody {
    double* gradient;
    ExposureGate gate;
    TVSGS_HD void operator()(int) const { gradient[kExposureValues] = gate.open(); }
};

/// Adam with rate 1e-3, betas 0.9 and 0.99, eps 1e-8, over all photographs. Photographs other than
/// `current` continue by their momentum, as in the official code.
struct ExposureStepBody {
    Span<ExposureState> states;
    int current;
    const double* gradient;  // of the L1 term by the current exposure; then whether to step

    TVSGS_HD void operator()(int i) const {
        if (!(gradient[kExposureValues] > 0)) return;
        ExposureState& s = states[i];
        ++s.steps;
        const float t = float(s.steps);
        const float correction1 = 1 - std::pow(0.9f, t), correction2 = 1 - std::pow(0.99f, t);
        for (int k = 0; k < kExposureValues; ++k) {
            const float g = i == current ? float(gradient[k]) : 0;
            s.m[k] = 0.9f * s.m[k] + 0.1f * g;
            s.v[k] = 0.99f * s.v[k] + 0.01f * g * g;
            s.value[k] -=
                1e-3f * (s.m[k] / correction1) / (std::sqrt(s.v[k] / correction2) + 1e-8f);
        }
    }
};

template <class Device>
class Exposure {
public:
    /// `fits`: exposures are fitted. With `held` [view][values] they are constants.
    explicit Exposure(bool fits, const HeldExposures* held = nullptr)
        : held_(held != nullptr && !held->empty()) {
        if (held_) {
            std::vector<ExposureState> states(held->size(), ExposureState{});
            for (std::size_t i = 0; i < states.size(); ++i)
                std::copy((*held)[i].begin(), (*held)[i].end(), states[i].value);
            copy(states, states_);
            return;
        }
        if (!fits) return;
        gradient_.resize(kExposureValues + 1);
        gradient_.fill_zero();
    }

    /// Adds the L1 term with the view's exposure, and keeps the gradient for step().
    void add_l1(const LossInputs<Device>& in,
                const ComparedPhoto& compared,
                int views,
                float weight,
                double* ssim_loss,
                double limit,
                Objective<Device>& objective,
                Span<float> pixel_loss) {
        require_states(views);
        if (!held_) gradient_.fill_zero();
        const std::size_t pixels = in.images.color.size();
        per_pixel_.resize(kExposureValues * pixels);
        const ExposureGate gate{ssim_loss, limit};
        const ExposureState* const own = states_.data() + in.view.index;
        parallel_for(Device{}, int(pixels),
                     ExposureL1Body{compared, own, gate, weight / (3 * float(pixels)), pixel_loss,
                                    per_pixel_.span()});
        if (held_) return;
        for (int k = 0; k < kExposureValues; ++k) {
            const float* const of_value = per_pixel_.data() + std::size_t(k) * pixels;
            add_sum(Device{}, int(pixels), ReadValue{{of_value, pixels}}, 1,
                    objective.partial.span(), gradient_.data() + k);
        }
        parallel_for(Device{}, 1, ExposureOpenBody{gradient_.data(), gate});
    }

    /// Steps the exposures by the gradient of the last add_l1(), called for photograph `view`.
    void step(int view, int views) {
        parallel_for(Device{}, views, ExposureStepBody{states_.span(), view, gradient_.data()});
    }

    void state(StateVisitor<Device>& visit) {
        if (!held_) visit.optional("exposure", states_);
    }

    bool held() const { return held_; }
    /// Returns an empty list before any exposures are fitted.
    HeldExposures values() const {
        HeldExposures out;
        for (const ExposureState& s : to_host(states_)) out.push_back(std::to_array(s.value));
        return out;
    }

    const Buffer<ExposureState, Device>& states() const { return states_; }

private:
    void require_states(int views) {
        if (int(states_.size()) == views) return;
        if (held_)
            throw Error(ExitCode::usage, "loss.photometric.exposure_from: has exposures of ",
                        states_.size(), " views, expected ", views);
        states_.resize(views);
        states_.fill_zero();
    }

    bool held_;
    Buffer<ExposureState, Device> states_;
    Buffer<double, Device> gradient_;
    Buffer<float, Device> per_pixel_;
};

}  // namespace tvsgs
