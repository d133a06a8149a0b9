// Rules and kernels of growing and pruning, see densify.h.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "core/math/quantile.h"
#include "core/math/rng.h"
#include "core/math/smoothing_filter.h"
#include "core/scene/gaussians.h"

namespace tvsgs {

/// Running sums that growth rules read.
struct GrowthStatistics {
    float gradient, abs_gradient, views, max_radius_px;

    TVSGS_HD float mean_gradient() const { return views > 0 ? gradient / views : 0; }
    TVSGS_HD float mean_abs_gradient() const { return views > 0 ? abs_gradient / views : 0; }
};

enum class Growth : std::uint8_t { none, clone, split, abs_split };

TVSGS_HD inline float largest_scale(Vec3f log_scales) {
    const Vec3f l = log_scales;
    return std::exp(l.x > l.y ? (l.x > l.z ? l.x : l.z) : (l.y > l.z ? l.y : l.z));
}

enum class GrowthRule { thresholds, quantile };

/// Proposes the growth of each splat: a mean screen gradient above a threshold clones small splats
/// and splits large ones. By `thresholds`, large ones also split by their mean absolute gradient.
/// By `quantile`, splats of either size also grow by it; splats without a gradient never grow.
/// [docs/method/pgsr.md#growth, docs/method/rade.md#growth]
struct ProposeBody {
    // Radius on the screen above which a splat splits by its absolute gradient.  [PGSR]
    static constexpr float kAbsRadiusPx = 20;

    GrowthRule rule;
    Span<const GrowthStatistics> statistics;
    Span<const Vec3f> log_scales;
    float gradient_threshold, abs_threshold;  // per NDC unit
    float size_threshold;                     // of the largest scale, world units
    Span<Growth> growth;                      // overwritten
    Span<float> score;                        // overwritten; quotas rank splats by it

    TVSGS_HD void operator()(int i) const {
        const GrowthStatistics& s = statistics[i];
        const float gradient = s.mean_gradient(), abs = s.mean_abs_gradient();
        const bool large = largest_scale(log_scales[i]) > size_threshold,
                   by_abs = abs >= abs_threshold,
                   grows = gradient >= gradient_threshold ||
                           (rule == GrowthRule::quantile && abs > 0 && by_abs),
                   abs_splits = !grows && rule == GrowthRule::thresholds && large &&
                                s.max_radius_px > kAbsRadiusPx && by_abs;
        growth[i] = grows        ? (large ? Growth::split : Growth::clone)
                    : abs_splits ? Growth::abs_split
                                 : Growth::none;
        score[i] = grows ? gradient : abs_splits ? abs : 0;
    }
};

/// `abs_threshold` of the rule `quantile`: with rho N splats above the threshold of the gradient,
/// at most rho N more grow, except for ties. Found on the host: growth is rare, and both devices
/// get the same result.
template <class Device>
float abs_quantile(const Buffer<GrowthStatistics, Device>& statistics, float gradient_threshold) {
    std::vector<float> abs;
    std::int64_t above = 0;
    for (const GrowthStatistics& s : to_host(statistics)) {
        abs.push_back(s.mean_abs_gradient());
        above += s.mean_gradient() >= gradient_threshold;
    }
    const double share = abs.empty() ? 0 : double(above) / double(abs.size());
    return quantile(abs, 1 - share);
}

/// Contribution of one view to GrowthStatistics::abs_gradient. `sums`: per component, the sum of
/// absolute values over its pixels.
TVSGS_HD inline float abs_gradient_of_view(GrowthRule rule, Vec2f sums) {
    return rule == GrowthRule::quantile ? sums.x + sums.y : std::sqrt(dot(sums, sums));
}

/// Weight of growth per splat, 0 to 1. [docs/guide/plan.md#growth-in-gaps]
struct GrowthWeights {
    Span<const float> open;  // [N] open_shares(), inherited; or empty: 1
    float growth_in_gaps_only;
    TVSGS_HD float operator()(int i) const {
        return open.empty() ? 1 : (1 - growth_in_gaps_only) * (1 + growth_in_gaps_only * open[i]);
    }
};

struct AccumulateBody {
    Span<const float> radii_px;
    Span<const Vec2f> gradient, abs_gradient;
    Span<const int> front_pixels;
    GrowthRule rule;
    GrowthWeights weights;
    Span<GrowthStatistics> statistics;

    TVSGS_HD void operator()(int i) const {
        if (!(radii_px[i] > 0)) return;
        GrowthStatistics& s = statistics[i];
        const float weight = weights(i);
        s.gradient += weight * std::sqrt(dot(gradient[i], gradient[i]));
        s.abs_gradient += weight * abs_gradient_of_view(rule, abs_gradient[i]);
        s.views += 1;
        if (front_pixels[i] > 0 && radii_px[i] > s.max_radius_px) s.max_radius_px = radii_px[i];
    }
};

/// Number of splats that replace splat i: 0, 1 or 2, pruning included.
struct CountBody {
    Span<const Growth> growth;
    Span<const Vec3f> log_scales;
    Span<const float> opacity_logits;
    float min_opacity_logit, max_scale;  // max_scale: infinite while large splats are not pruned
    GrowthWeights weights;
    Span<int> counts;

    TVSGS_HD void operator()(int i) const {
        const bool split = growth[i] >= Growth::split;
        const float largest = largest_scale(log_scales[i]) / (split ? 1.6f : 1.0f);
        const float weight = weights(i);
        // The opacity of a faint splat is about the exponential of its logit.
        const bool pruned = opacity_logits[i] < min_opacity_logit + std::log(weight) ||
                            weight * largest > max_scale;
        counts[i] = pruned ? 0 : growth[i] == Growth::none ? 1 : 2;
    }
};

/// Writes the source of each new splat, and its kind.
struct SourceBody {
    Span<const Growth> growth;
    Span<const int> counts, first;
    Span<int> parents;
    Span<std::uint8_t> is_new, child_of_split;  // new: its moments start at 0

    TVSGS_HD void operator()(int i) const {
        for (int j = 0; j < counts[i]; ++j) {
            const int at = first[i] + j;
            const bool split = counts[i] == 2 && growth[i] >= Growth::split;
            parents[at] = i;
            child_of_split[at] = split;
            is_new[at] = split || j == 1;
        }
    }
};

/// Moves children of splits and jittered clones by a random draw from their parent's Gaussian, and
/// shrinks children of splits.
struct ScatterChildrenBody {
    Span<const std::uint8_t> is_new, child_of_split;
    bool jitter_clones;
    std::uint64_t seed;
    std::uint32_t step;
    Span<Vec3f> means, log_scales;
    Span<const Quatf> quats;

    TVSGS_HD void operator()(int i) const {
        if (!is_new[i] || !(child_of_split[i] || jitter_clones)) return;
        const Vec3f xi = normal3(random4(seed, RandomStream::densify, std::uint64_t(i), step));
        means[i] += rotation(normalize(quats[i])) * (exp(log_scales[i]) * xi);
        if (!child_of_split[i]) return;
        const float log_shrink = 0.47000363f;  // ln 1.6
        log_scales[i] -= Vec3f{log_shrink, log_shrink, log_shrink};
    }
};

/// Lowers rendered opacities to at most `reset`, or to a higher limit where the growth weight is
/// below 1. Where a smoothing filter dims a splat, its stored opacity stays higher by that factor.
struct ResetOpacityBody {
    float reset, reset_logit;
    Span<const Vec3f> log_scales;
    Span<const float> filter;  // or empty
    GrowthWeights weights;
    Span<float> logits;
    Span<float> m, v;
    TVSGS_HD void operator()(int i) const {
        const float weight = weights(i), most = reset + (1 - weight) * (1 - reset);
        if (!(most < 1)) return;
        float limit = weight < 1 ? std::log(most / (1 - most)) : reset_logit;
        if (!filter.empty()) {
            const float own = most / smoothed(log_scales[i], filter[i]).dimming;
            limit = own < 1 ? std::log(own / (1 - own)) : logits[i];
        }
        logits[i] = logits[i] < limit ? logits[i] : limit;
        m[i] = v[i] = 0;
    }
};

/// Restores unit length of the stored quaternions; renderers normalise on use anyway.
struct NormalizeQuatBody {
    Span<Quatf> quats;
    TVSGS_HD void operator()(int i) const { quats[i] = normalize(quats[i]); }
};

struct CountFrontViewsBody {
    Span<const int> front_pixels;
    Span<int> views;
    TVSGS_HD void operator()(int i) const { views[i] += front_pixels[i] > 0; }
};

struct KeepSeenBody {
    Span<const int> views;
    int min_views;
    GrowthWeights weights;
    Span<int> counts;
    Span<Growth> growth;
    TVSGS_HD void operator()(int i) const {
        counts[i] = float(views[i]) >= weights(i) * float(min_views);
        growth[i] = Growth::none;
    }
};

}  // namespace tvsgs
