// A brightness and an offset per photograph, or a colour matrix as well, for cameras and lights
// that do as they like. [docs/method/pgsr.md#exposure]
#pragma once

#include "core/error.h"
#include "core/parallel.h"
#include "optim/loss.h"
#include "optim/photo_background.h"
#include "render/photometric.h"

namespace tvsgs {

/// The two images that the photometric terms compare.
struct ComparedPhoto {
    Span<const Vec3f> color;         // [H W] the render
    Span<const std::uint8_t> photo;  // [H W 3]
    Span<Vec3f> dL_dcolor;           // [H W] added to
    Span<const float> mask;          // [H W] of the view; empty: all is inside
};

/// Numbers per photograph: A and B, and of the affine model E [3 4] by rows.
inline constexpr int kGainValues = 2, kAffineValues = 14;

/// e^A c + B + E (c, 1) of a render's colour c, with as many of the numbers as `count` says; of
/// zeros c itself.
template <class Real>
TVSGS_HD Vec3<Real> exposed(const Real* values, int count, Vec3<Real> c) {
    const Real gain = std::exp(values[0]), offset = values[1];
    Vec3<Real> out;
    for (int row = 0; row < 3; ++row) {
        out[row] = gain * c[row] + offset;
        if (count == kGainValues) continue;
        const Real* const e = values + kGainValues + 4 * row;
        out[row] += e[0] * c.x + e[1] * c.y + e[2] * c.z + e[3];
    }
    return out;
}

template <class Real>
struct ExposedVjp {
    Vec3<Real> dL_dcolor;
    Real dL_dvalues[kAffineValues];
};
template <class Real>
TVSGS_HD ExposedVjp<Real> exposed_vjp(const Real* values,
                                      int count,
                                      Vec3<Real> c,
                                      Vec3<Real> dL_dexposed) {
    const Real gain = std::exp(values[0]);
    ExposedVjp<Real> out{};
    for (int row = 0; row < 3; ++row) {
        const Real g = dL_dexposed[row];
        out.dL_dvalues[0] += g * (gain * c[row]);
        out.dL_dvalues[1] += g;
        out.dL_dcolor[row] += g * gain;
        if (count == kGainValues) continue;
        for (int k = 0; k < 4; ++k) {
            const int at = kGainValues + 4 * row + k;
            out.dL_dvalues[at] = k < 3 ? g * c[k] : g;
            if (k < 3) out.dL_dcolor[k] += g * values[at];
        }
    }
    return out;
}

struct ExposureState {
    float value[kAffineValues];
    float m[kAffineValues], v[kAffineValues];
    int steps;
};

/// Exposure is applied and fitted only where a render resembles its photograph: where the sum of
/// the SSIM term's shares, which stays on the device, is below `limit`.
struct ExposureGate {
    const double* ssim_loss;
    double limit;
    TVSGS_HD bool open() const { return *ssim_loss < limit; }
};

/// The L1 term of one pixel, and its part of the derivative by the photograph's numbers.
struct ExposureL1Body {
    ComparedPhoto compared;
    const ExposureState* exposure;
    int count;
    ExposureGate gate;
    float weight_per_value;
    Span<float> pixel_loss;  // added to
    Span<float> dL_dvalues;  // [count H W] overwritten

    TVSGS_HD void operator()(int i) const {
        // What a mask has put in the place of a photograph was not exposed.
        const bool on = gate.open() && (compared.mask.empty() || is_inside(compared.mask[i]));
        const Vec3f photo_i = detail::photo_pixel(compared.photo.data, static_cast<std::size_t>(i)),
                    color = compared.color[i],
                    shown = on ? exposed(exposure->value, count, color) : color;
        Vec3f g;
        float loss = 0;
        for (int c = 0; c < 3; ++c) {
            const float d = shown[c] - photo_i[c];
            g[c] = d > 0 ? weight_per_value : d < 0 ? -weight_per_value : 0;
            loss += g[c] * d;
        }
        pixel_loss[i] += loss;
        ExposedVjp<float> vjp{g, {}};
        if (on) vjp = exposed_vjp(exposure->value, count, color, g);
        compared.dL_dcolor[i] += vjp.dL_dcolor;
        const std::size_t pixels = compared.color.size();
        for (int k = 0; k < count; ++k)
            dL_dvalues[static_cast<std::size_t>(k) * pixels + static_cast<std::size_t>(i)] =
                vjp.dL_dvalues[k];
    }
};

/// What a colour matrix costs: `pull` times the sum of its squares.
struct ExposurePullTerm {
    const ExposureState* exposure;
    ExposureGate gate;
    float pull;
    TVSGS_HD float operator()(int k) const {
        const float e = exposure->value[kGainValues + k];
        return gate.open() ? pull * e * e : 0;
    }
};

/// Writes behind the gradient whether exposures step: gradient[count].
struct ExposureOpenBody {
    double* gradient;
    int count;
    ExposureGate gate;
    TVSGS_HD void operator()(int) const { gradient[count] = gate.open(); }
};

/// Adam, rate 1e-3, betas 0.9 and 0.99, eps 1e-8, over all photographs: those not looked at go on
/// by their momentum, as in the official code.
struct ExposureStepBody {
    Span<ExposureState> states;
    int current, count;
    const double* gradient;  // [count] of the L1 term by the current one; then whether to step
    float pull;

    TVSGS_HD void operator()(int i) const {
        if (!(gradient[count] > 0)) return;
        ExposureState& s = states[i];
        ++s.steps;
        const float t = static_cast<float>(s.steps);
        const float correction1 = 1 - std::pow(0.9f, t), correction2 = 1 - std::pow(0.99f, t);
        for (int k = 0; k < count; ++k) {
            const float pulled = k < kGainValues ? 0 : 2 * pull * s.value[k],
                        g = i == current ? static_cast<float>(gradient[k]) + pulled : 0;
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
    /// With `held` [view][values] exposures are constants.
    Exposure(ExposureModel model, float pull, const HeldExposures* held = nullptr)
        : count_(model == ExposureModel::affine ? kAffineValues : kGainValues),
          pull_(pull),
          held_(held != nullptr && !held->empty()) {
        if (held_) {
            count_ = static_cast<int>(held->front().size());
            std::vector<ExposureState> states(held->size(), ExposureState{});
            for (std::size_t i = 0; i < states.size(); ++i)
                std::copy((*held)[i].begin(), (*held)[i].end(), states[i].value);
            copy(states, states_);
            return;
        }
        if (model == ExposureModel::none) return;
        gradient_.resize(static_cast<std::size_t>(count_) + 1);
        gradient_.fill_zero();
    }

    /// Adds the L1 term with the view's exposure, adds the cost of its matrix to `value`, and keeps
    /// the gradient for step(). `gate.ssim_loss` has to be known.
    void add_l1(const LossInputs<Device>& in,
                const ComparedPhoto& compared,
                int views,
                float weight,
                double* ssim_loss,
                double limit,
                Objective<Device>& objective,
                Span<float> pixel_loss,
                double* value) {
        require_states(views);
        if (!held_) gradient_.fill_zero();
        const std::size_t pixels = in.images.color.size();
        per_pixel_.resize(static_cast<std::size_t>(count_) * pixels);
        const ExposureGate gate{ssim_loss, limit};
        const ExposureState* const own = states_.data() + in.view.index;
        parallel_for(
            Device{}, static_cast<int>(pixels),
            ExposureL1Body{compared, own, count_, gate, weight / (3 * static_cast<float>(pixels)),
                           pixel_loss, per_pixel_.span()});
        if (held_) return;
        for (int k = 0; k < count_; ++k) {
            const float* const of_value = per_pixel_.data() + static_cast<std::size_t>(k) * pixels;
            add_sum(Device{}, static_cast<int>(pixels), ReadValue{{of_value, pixels}}, 1,
                    objective.partial.span(), gradient_.data() + k);
        }
        if (count_ > kGainValues)
            add_sum(Device{}, count_ - kGainValues, ExposurePullTerm{own, gate, pull_}, 1,
                    objective.partial.span(), value);
        parallel_for(Device{}, 1, ExposureOpenBody{gradient_.data(), count_, gate});
    }

    /// Steps the exposures by the gradient of the last add_l1(), which was of photograph `view`.
    void step(int view, int views) {
        parallel_for(Device{}, views,
                     ExposureStepBody{states_.span(), view, count_, gradient_.data(), pull_});
    }

    void state(StateVisitor<Device>& visit) {
        if (!held_) visit.optional("exposure", states_);
    }

    bool held() const { return held_; }
    /// [view][values]; empty before any are fitted.
    HeldExposures values() const {
        HeldExposures out;
        for (const ExposureState& s : to_host(states_)) out.emplace_back(s.value, s.value + count_);
        return out;
    }

    const Buffer<ExposureState, Device>& states() const { return states_; }

private:
    void require_states(int views) {
        if (static_cast<int>(states_.size()) == views) return;
        if (held_)
            throw Error(ExitCode::usage,
                        str("loss.photometric.exposure_from: exposures of ", states_.size(),
                            " views are held, and ", views, " train"));
        states_.resize(static_cast<std::size_t>(views));
        states_.fill_zero();
    }

    int count_;
    float pull_;
    bool held_;
    Buffer<ExposureState, Device> states_;
    Buffer<double, Device> gradient_;
    Buffer<float, Device> per_pixel_;
};

}  // namespace tvsgs
