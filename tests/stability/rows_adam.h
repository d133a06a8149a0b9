// Rows of the stability suite: Adam.
#pragma once

#include "optim/optimiser/adam.h"
#include "stability/row.h"

namespace tvsgs::stability {

/// What Adam has moved a parameter by after a number of steps with gradients that change sign now
/// and then, in learning rates per step.
struct AdamSteps {
    static constexpr int kIn = 2, kOut = 1;

    template <class Real>
    TVSGS_HD static void evaluate(const Real* in, Real* out) {
        const int steps = static_cast<int>(in[0]);
        Real m = 0, v = 0, moved = 0;
        // As adam_scale() does: powers in double, once per step.
        double power1 = 1, power2 = 1;
        for (int t = 1; t <= steps; ++t) {
            power1 *= 0.9, power2 *= 0.999;
            const Real gradient = in[1] * (t % 5 ? Real(1) : Real(-1)) * (1 + Real(t % 3) / 4);
            // From zero: how a step changes a value is what counts, not the value's own rounding.
            moved = adam_update(Real(0), gradient, m, v, Real(1 / (1 - power1)),
                                Real(1 / std::sqrt(1 - power2)));
        }
        out[0] = moved;
    }
    static double size(const double*, const double*) { return 1; }
    static double bound(const double*, const double*) {
        // m forgets after 10 steps, v after 1,000; half of v's error is the step's.
        return kRounding * (2 * 10 + 1000);
    }
};
struct AdamCount : AdamSteps {
    static constexpr RowText text{"Adam: one step, learning rates", "step number",
                                  "1,020 roundings, the memory of both moments", ""};
    static constexpr double kFrom = 1, kTo = 1e5;
    static void fill(double stress, Case& make) {
        make.put(std::floor(stress)), make.put(std::pow(10.0, make.uniform(-8, 0)));
    }
};
struct AdamGradient : AdamSteps {
    static constexpr RowText text{
        "Adam: one step, learning rates", "size of the gradients",
        "1,020 roundings; epsilon of 1e-15 rules below",
        "v beyond float's range: no step; the check of moments ends in a rollback"};
    static constexpr double kFrom = 1e-30, kTo = 1e18;
    static void fill(double stress, Case& make) { make.put(30), make.put(stress); }
};

}  // namespace tvsgs::stability
