// Runs the rows of the stability suite; a kernel evaluates them on a GPU.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/device/parallel.h"
#include "stability/measure.h"
#include "stability/row.h"

namespace tvsgs::stability {

inline constexpr int kSteps = 19;  // of a sweep
inline constexpr int kCases = 24;  // per step

template <class Row>
struct EvaluateBody {
    Span<const float> in;
    Span<float> out;

    TVSGS_HD void operator()(int i) const {
        Row::template evaluate<float>(&in[std::size_t(i) * Row::kIn],
                                      &out[std::size_t(i) * Row::kOut]);
    }
};

template <class Row>
double stress_at(int step) {
    return Row::kFrom * std::pow(Row::kTo / Row::kFrom, double(step) / (kSteps - 1));
}

template <class Row, class Device>
StabilityCurve sweep() {
    // 1. The cases, in float.
    std::vector<float> in(std::size_t(kSteps) * kCases * Row::kIn);
    for (int i = 0; i < kSteps * kCases; ++i) {
        double numbers[Row::kIn] = {};
        Case make(std::uint64_t(i % kCases), numbers);
        Row::fill(stress_at<Row>(i / kCases), make);
        std::copy_n(numbers, Row::kIn, in.begin() + std::ptrdiff_t(i) * Row::kIn);
    }

    // 2. The formula in float.
    const auto device_in = to_device<Device>(in);
    Buffer<float, Device> device_out(std::size_t(kSteps) * kCases * Row::kOut);
    parallel_for(Device{}, kSteps * kCases, EvaluateBody<Row>{device_in.span(), device_out.span()});
    const std::vector<float> out = to_host(device_out);

    // 3. Against double.
    StabilityCurve curve{Row::text.operation, Row::text.stress, Row::text.bound, Row::text.guard,
                         std::vector<StabilityPoint>(kSteps)};
    for (int i = 0; i < kSteps * kCases; ++i) {
        double numbers[Row::kIn], exact[Row::kOut];
        std::copy_n(in.begin() + std::ptrdiff_t(i) * Row::kIn, Row::kIn, numbers);
        Row::template evaluate<double>(numbers, exact);
        double error = 0;
        for (int k = 0; k < Row::kOut; ++k) {
            const double off = std::abs(double(out[std::size_t(i) * Row::kOut + k]) - exact[k]);
            // A result that is not finite is no result.
            error =
                std::isfinite(off) ? std::max(error, off) : std::numeric_limits<double>::infinity();
        }
        if (error > 0) error /= Row::size(numbers, exact);
        const double bound = Row::bound(numbers, exact);
        StabilityPoint& point = curve.points[std::size_t(i / kCases)];
        point.stress = stress_at<Row>(i / kCases);
        point.error = std::max(point.error, error);
        point.bound = std::max(point.bound, bound);
        point.share = std::max(point.share, error / bound);
    }
    return curve;
}

template <class Device, class... Rows>
void sweep_all(std::vector<StabilityCurve>& curves) {
    (curves.push_back(sweep<Rows, Device>()), ...);
}

}  // namespace tvsgs::stability
