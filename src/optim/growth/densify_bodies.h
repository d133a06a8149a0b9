// Kernels of growing and pruning, see densify.h.
#pragma once

#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"
#include "core/math/rng.h"
#include "core/math/smoothing_filter.h"
#include "core/scene/gaussians.h"
#include "optim/growth/growth_rules.h"

namespace tvsgs {

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
        const Vec3f xi =
            normal3(random4(seed, RandomStream::densify, static_cast<std::uint64_t>(i), step));
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
        counts[i] = static_cast<float>(views[i]) >= weights(i) * static_cast<float>(min_views);
        growth[i] = Growth::none;
    }
};

}  // namespace tvsgs
