// List of growth rules: which splats grow, and how. To add one, write a function, add its name to
// GrowthRule and DensifyOptions, and a case to propose_growth().
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/device/parallel.h"
#include "core/math/quantile.h"
#include "core/scene/gaussians.h"

namespace tvsgs {

/// Running sums that growth rules read.
struct GrowthStatistics {
    float gradient, abs_gradient, views, max_radius_px;

    TVSGS_HD float mean_gradient() const { return views > 0 ? gradient / views : 0; }
    TVSGS_HD float mean_abs_gradient() const { return views > 0 ? abs_gradient / views : 0; }
};

enum class Growth : std::uint8_t { none, clone, split, abs_split };

/// Inputs of a growth rule, one entry per splat.
template <class Device>
struct GrowthInputs {
    const Buffer<GrowthStatistics, Device>& statistics;
    Span<const Vec3f> log_scales;
    float gradient_threshold, abs_gradient_threshold;  // per NDC unit
    float size_threshold;                              // of the largest scale, world units

    int size() const { return log_scales.size(); }
};

TVSGS_HD inline float largest_scale(Vec3f log_scales) {
    const Vec3f l = log_scales;
    return std::exp(l.x > l.y ? (l.x > l.z ? l.x : l.z) : (l.y > l.z ? l.y : l.z));
}

/// Mean screen gradients above a threshold clone small splats and split large ones; large ones also
/// split by their mean absolute gradient.  [docs/method/pgsr.md#growth]
struct ThresholdsBody {
    // Radius on the screen above which a splat splits by its absolute gradient.  [PGSR]
    static constexpr float kAbsRadiusPx = 20;

    Span<const GrowthStatistics> statistics;
    Span<const Vec3f> log_scales;
    float gradient_threshold, abs_threshold, size_threshold;
    Span<Growth> growth;
    Span<float> score;

    TVSGS_HD void operator()(int i) const {
        const GrowthStatistics& s = statistics[i];
        const float gradient = s.mean_gradient(), abs = s.mean_abs_gradient();
        const bool large = largest_scale(log_scales[i]) > size_threshold;
        growth[i] = gradient >= gradient_threshold ? (large ? Growth::split : Growth::clone)
                    : large && s.max_radius_px > kAbsRadiusPx && abs >= abs_threshold
                        ? Growth::abs_split
                        : Growth::none;
        score[i] = growth[i] == Growth::none ? 0 : growth[i] == Growth::abs_split ? abs : gradient;
    }
};

/// A rule as propose_growth() calls it.
template <class Device>
void grow_by_thresholds(const GrowthInputs<Device>& in, Span<Growth> growth, Span<float> score) {
    parallel_for(Device{}, in.size(),
                 ThresholdsBody{in.statistics.span(), in.log_scales, in.gradient_threshold,
                                in.abs_gradient_threshold, in.size_threshold, growth, score});
}

/// Grows splats whose mean screen gradient is above a threshold. Also grows splats whose mean
/// absolute gradient lies in the top quantile of the same share: with rho N splats above the
/// threshold, at most rho N more, except for ties. Clones small splats and splits large ones;
/// splats without a gradient never grow. [docs/method/rade.md#growth]
struct QuantileBody {
    Span<const GrowthStatistics> statistics;
    Span<const Vec3f> log_scales;
    float gradient_threshold, abs_quantile, size_threshold;
    Span<Growth> growth;
    Span<float> score;

    TVSGS_HD void operator()(int i) const {
        const GrowthStatistics& s = statistics[i];
        const float gradient = s.mean_gradient(), abs = s.mean_abs_gradient();
        const bool grows = gradient >= gradient_threshold || (abs > 0 && abs >= abs_quantile);
        growth[i] = !grows                                          ? Growth::none
                    : largest_scale(log_scales[i]) > size_threshold ? Growth::split
                                                                    : Growth::clone;
        score[i] = grows ? gradient : 0;
    }
};

/// A rule as propose_growth() calls it. The quantile is found on the host: growth is rare, and both
/// devices get the same result.
template <class Device>
void grow_by_quantile(const GrowthInputs<Device>& in, Span<Growth> growth, Span<float> score) {
    std::vector<float> abs;
    std::int64_t above = 0;
    for (const GrowthStatistics& s : to_host(in.statistics)) {
        abs.push_back(s.mean_abs_gradient());
        above += s.mean_gradient() >= in.gradient_threshold;
    }
    const double share =
        abs.empty() ? 0 : static_cast<double>(above) / static_cast<double>(abs.size());
    parallel_for(Device{}, in.size(),
                 QuantileBody{in.statistics.span(), in.log_scales, in.gradient_threshold,
                              quantile(abs, 1 - share), in.size_threshold, growth, score});
}

enum class GrowthRule { thresholds, quantile };

/// Contribution of one view to GrowthStatistics::abs_gradient. `sums`: per component, the sum of
/// absolute values over its pixels.
TVSGS_HD inline float abs_gradient_of_view(GrowthRule rule, Vec2f sums) {
    return rule == GrowthRule::quantile ? sums.x + sums.y : std::sqrt(dot(sums, sums));
}

/// Overwrites `growth` with the proposal of a rule for each splat, and `score` with the number that
/// quotas rank splats by.
template <class Device>
void propose_growth(GrowthRule rule,
                    const GrowthInputs<Device>& in,
                    Span<Growth> growth,
                    Span<float> score) {
    switch (rule) {
        case GrowthRule::thresholds:
            return grow_by_thresholds(in, growth, score);
        case GrowthRule::quantile:
            return grow_by_quantile(in, growth, score);
    }
}

}  // namespace tvsgs
