// Which splats grow, and how: the list of rules. Another one is a function, its name in GrowthRule
// and in DensifyOptions, and a line in propose_growth().
#pragma once

#include <cmath>
#include <cstdint>

#include "core/gaussians.h"
#include "core/parallel.h"

namespace tvsgs {

/// Running sums of what decides about growth.
struct GrowthStatistics {
    float gradient, abs_gradient, views, max_radius_px;
};

enum class Growth : std::uint8_t { none, clone, split, abs_split };

/// What a rule goes by.
template <class Device>
struct GrowthInputs {
    Span<const GrowthStatistics> statistics;  // [N]
    const Gaussians<Device>& gaussians;
    float gradient_threshold, abs_gradient_threshold;  // per NDC unit
    float size_threshold;                              // of the largest scale, world units
    float abs_radius_px;
};

/// Mean screen gradients above a threshold clone small splats and split large ones; large ones also
/// split by their mean absolute gradient.  [docs/method/pgsr.md#growth]
struct ThresholdsBody {
    Span<const GrowthStatistics> statistics;
    Span<const Vec3f> log_scales;
    float gradient_threshold, abs_threshold, size_threshold, abs_radius_px;
    Span<Growth> growth;
    Span<float> score;

    TVSGS_HD void operator()(int i) const {
        const GrowthStatistics& s = statistics[i];
        const float gradient = s.views > 0 ? s.gradient / s.views : 0,
                    abs = s.views > 0 ? s.abs_gradient / s.views : 0;
        const Vec3f l = log_scales[i];
        const float largest =
            std::exp(l.x > l.y ? (l.x > l.z ? l.x : l.z) : (l.y > l.z ? l.y : l.z));
        const bool large = largest > size_threshold;
        growth[i] = gradient >= gradient_threshold ? (large ? Growth::split : Growth::clone)
                    : large && s.max_radius_px > abs_radius_px && abs >= abs_threshold
                        ? Growth::abs_split
                        : Growth::none;
        score[i] = growth[i] == Growth::none ? 0 : growth[i] == Growth::abs_split ? abs : gradient;
    }
};

/// As propose_growth().
template <class Device>
void grow_by_thresholds(const GrowthInputs<Device>& in, Span<Growth> growth, Span<float> score) {
    parallel_for(Device{}, in.gaussians.size(),
                 ThresholdsBody{in.statistics, in.gaussians.log_scales.span(),
                                in.gradient_threshold, in.abs_gradient_threshold, in.size_threshold,
                                in.abs_radius_px, growth, score});
}

enum class GrowthRule { thresholds };

/// Overwrites the growth that a rule proposes for each splat, and the score by which a quota would
/// choose, both [N].
template <class Device>
void propose_growth(GrowthRule rule,
                    const GrowthInputs<Device>& in,
                    Span<Growth> growth,
                    Span<float> score) {
    switch (rule) {
        case GrowthRule::thresholds:
            return grow_by_thresholds(in, growth, score);
    }
}

}  // namespace tvsgs
