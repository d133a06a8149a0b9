// Helpers of the gradient checks.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/device/cuda_device.h"
#include "core/device/device.h"
#include "core/math/vec.h"

namespace tvsgs::test {

/// (f(h) - f(-h)) / 2h, improved by one Richardson step: the error falls with h^4.
template <class F>
double central_difference(const F& f, double h = 1e-3) {
    const double coarse = (f(h) - f(-h)) / (2 * h), fine = (f(h / 2) - f(-h / 2)) / h;
    return (4 * fine - coarse) / 3;
}

/// |a - b| <= relative * max(|a|, |b|, scale).
inline ::testing::AssertionResult close(double a, double b, double relative, double scale = 1e-3) {
    const double bound = relative * std::max({std::abs(a), std::abs(b), scale});
    if (std::abs(a - b) <= bound) return ::testing::AssertionSuccess();
    return ::testing::AssertionFailure()
           << a << " against " << b << ", difference " << std::abs(a - b) << " above " << bound;
}

class Random {
public:
    explicit Random(unsigned seed) : engine_(seed) {}
    double uniform(double low, double high) {
        return std::uniform_real_distribution<double>(low, high)(engine_);
    }
    double normal() { return std::normal_distribution<double>()(engine_); }
    Vec3<double> normal3() { return {normal(), normal(), normal()}; }
    Quat<double> quat() { return {normal(), normal(), normal(), normal()}; }

private:
    std::mt19937 engine_;
};

/// Why a CUDA test cannot run here; empty when it can.
inline std::string no_cuda() {
    if constexpr (!kHasCuda)
        return "this build has no CUDA";
    else
        return cuda_device_count() == 0 ? "no GPU on this machine" : "";
}

}  // namespace tvsgs::test
