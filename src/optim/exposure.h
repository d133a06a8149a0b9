// A brightness and an offset per photograph, for cameras that expose as they like.
// [docs/method/pgsr.md#exposure]
#pragma once

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

/// e^A I + B takes the place of the render I in the L1 term.
struct ExposureState {
    float value[2];  // A, B
    float m[2], v[2];
    int steps;
};

/// Exposure is applied and fitted only where a render resembles its photograph: where the sum of
/// the SSIM term's shares, which stays on the device, is below `limit`.
struct ExposureGate {
    const double* ssim_loss;
    double limit;
    TVSGS_HD bool open() const { return *ssim_loss < limit; }
};

/// The L1 term of one pixel, and its part of the derivative by A and B.
struct ExposureL1Body {
    ComparedPhoto compared;
    const ExposureState* exposure;
    ExposureGate gate;
    float weight_per_value;
    Span<float> pixel_loss;    // added to
    Span<Vec2f> dL_dexposure;  // [H W] overwritten

    TVSGS_HD void operator()(int i) const {
        // What a mask has put in the place of a photograph was not exposed.
        const bool on = gate.open() && (compared.mask.empty() || is_inside(compared.mask[i]));
        const float gain = on ? std::exp(exposure->value[0]) : 1,
                    offset = on ? exposure->value[1] : 0;
        const Vec3f photo_i = detail::photo_pixel(compared.photo.data, static_cast<std::size_t>(i));
        Vec2f sum{};
        float loss = 0;
        for (int c = 0; c < 3; ++c) {
            const float bright = gain * compared.color[i][c], d = bright + offset - photo_i[c];
            const float g = d > 0 ? weight_per_value : d < 0 ? -weight_per_value : 0;
            loss += g * d;
            compared.dL_dcolor[i][c] += g * gain;
            if (on) sum += Vec2f{g * bright, g};
        }
        pixel_loss[i] += loss;
        dL_dexposure[i] = sum;
    }
};

struct ExposureGradientTerm {
    Span<const Vec2f> values;
    bool second;
    TVSGS_HD float operator()(int i) const { return second ? values[i].y : values[i].x; }
};

/// Adam, rate 1e-3, betas 0.9 and 0.99, eps 1e-8, over all photographs: those not looked at go on
/// by their momentum, as in the official code.
struct ExposureStepBody {
    Span<ExposureState> states;
    int current;
    const double* gradient;  // [2] of the current one
    ExposureGate gate;

    TVSGS_HD void operator()(int i) const {
        if (!gate.open()) return;
        ExposureState& s = states[i];
        ++s.steps;
        const float t = static_cast<float>(s.steps);
        const float correction1 = 1 - std::pow(0.9f, t), correction2 = 1 - std::pow(0.99f, t);
        for (int k = 0; k < 2; ++k) {
            const float g = i == current ? static_cast<float>(gradient[k]) : 0;
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
    /// Adds the L1 term with the view's exposure and improves the exposures. `gate.ssim_loss` has
    /// to be known.
    void add_l1(const LossInputs<Device>& in,
                const ComparedPhoto& compared,
                int views,
                float weight,
                double* ssim_loss,
                double limit,
                Objective<Device>& objective,
                Span<float> pixel_loss) {
        if (static_cast<int>(states_.size()) != views) {
            states_.resize(static_cast<std::size_t>(views));
            states_.fill_zero();
        }
        gradient_.resize(2);
        gradient_.fill_zero();
        const std::size_t pixels = in.images.color.size();
        per_pixel_.resize(pixels);
        const ExposureGate gate{ssim_loss, limit};
        parallel_for(Device{}, static_cast<int>(pixels),
                     ExposureL1Body{compared, states_.data() + in.view.index, gate,
                                    weight / (3 * static_cast<float>(pixels)), pixel_loss,
                                    per_pixel_.span()});
        const Buffer<Vec2f, Device>& per_pixel = per_pixel_;
        for (int k = 0; k < 2; ++k)
            add_sum(Device{}, static_cast<int>(pixels),
                    ExposureGradientTerm{per_pixel.span(), k == 1}, 1, objective.partial.span(),
                    gradient_.data() + k);
        parallel_for(Device{}, views,
                     ExposureStepBody{states_.span(), in.view.index, gradient_.data(), gate});
    }

    void state(StateVisitor<Device>& visit) { visit.optional("exposure", states_); }

    const Buffer<ExposureState, Device>& states() const { return states_; }

private:
    Buffer<ExposureState, Device> states_;
    Buffer<double, Device> gradient_;
    Buffer<Vec2f, Device> per_pixel_;
};

}  // namespace tvsgs
