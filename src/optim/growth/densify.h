// Grows and prunes splats: clone, split, prune, trim, opacity reset, and reordering in memory.
// [Kerbl23, Section 5], rules of [PGSR]
#pragma once

#include <algorithm>

#include "core/device/parallel.h"
#include "core/device/scan.h"
#include "core/options.h"
#include "optim/growth/densify_bodies.h"
#include "optim/growth/splat_order.h"
#include "optim/optimiser/adam.h"
#include "render/backbone.h"

namespace tvsgs {

struct DensifyOptions {
    bool enabled = true;
    GrowthRule rule = GrowthRule::thresholds;
    int from = 500, until = 15000, every = 100, opacity_reset_every = 3000, trim_every = 1000,
        prune_large_after = 3000;
    float gradient_threshold = 2e-4f, percent_dense = 0.001f, min_opacity = 0.005f,
          reset_opacity = 0.01f, prune_large = 0.1f, abs_gradient_threshold = 8e-4f,
          growth_in_gaps_only = 0;
    int max_abs_split = 50000, trim_min_views = 2;
    bool jitter_clones = true;
    int max_gaussians = 6000000;
    float max_per_pixel = 1;

    template <class Visitor>
    void fields(Visitor& field) {
        field("enabled", enabled, "grow and prune splats");
        field.choice("rule", rule, {"thresholds", "quantile"},
                     "splats that grow; thresholds: mean screen gradient, for large splats also "
                     "mean absolute gradient, above a threshold; quantile: also as many with the "
                     "largest absolute gradients");
        field("from", from, {0, 1e9}, "last iteration without growth");
        field("until", until, {0, 1e9}, "first iteration without growth again");
        field("every", every, {1, 1e9}, "iterations between growth events");
        field("opacity_reset_every", opacity_reset_every, {1, 1e9},
              "iterations between opacity resets");
        // A lower value would make splats too faint to be drawn, and they would never recover.
        field("reset_opacity", reset_opacity, {0.00999, 0.999}, "opacity after a reset");
        field("trim_every", trim_every, {1, 1e9}, "iterations between trims");
        field("gradient_threshold", gradient_threshold, {0, 1e9},
              "mean screen gradient above which a splat grows, per NDC unit");
        field("percent_dense", percent_dense, {0, 1e3},
              "largest scale of splats that are cloned instead of split, in scene extents");
        field("min_opacity", min_opacity, {0, 1}, "prune splats below this opacity");
        field("prune_large", prune_large, {0, 1e6},
              "prune splats with a larger scale, in scene extents");
        field("prune_large_after", prune_large_after, {0, 1e9},
              "last iteration without that pruning");
        field("abs_gradient_threshold", abs_gradient_threshold, {0, 1e9},
              "mean absolute screen gradient that splits splats wider than 20 px, rule thresholds");
        field("max_abs_split", max_abs_split, {0, 1e9},
              "most splats split by abs_gradient_threshold at once; 0: none");
        field("trim_min_views", trim_min_views, {0, 1e6},
              "trim splats that are in front in fewer training views; 0: no trim");
        field("jitter_clones", jitter_clones,
              "move clones by a random draw from their splat (PGSR); false: same place (3DGS)");
        field("growth_in_gaps_only", growth_in_gaps_only, {0, 1},
              "share by which growth, pruning and resets are suppressed where the start cloud "
              "covers the photographs; 0: none, 1: fully");
        // The 45 SH floats of each splat are counted in int.
        field("max_gaussians", max_gaussians, {1, 4e7}, "number of splats at which growth stops");
        field("max_per_pixel", max_per_pixel, {0, 1e6},
              "splats per pixel of the training views at which growth stops; 0: no limit");
    }
};

template <class Device>
class Densifier {
public:
    Densifier(const DensifyOptions& options, float extent, std::uint64_t seed)
        : options_(options), extent_(extent), seed_(seed) {}

    /// Sets the open share of each splat, [N], see open_shares().
    void set_open(const std::vector<float>& open) { copy(open, open_); }

    /// Adds the statistics of the last render; grows, prunes, trims and resets when due. `observe`
    /// calls its argument with the statistics of each training view. Returns whether the structure
    /// changed; then parents() is valid. [docs/method/pgsr.md#growth]
    template <class Observe>
    bool step(int step,
              const ScreenStatistics<Device>& screen,
              Gaussians<Device>& g,
              Adam<Device>& adam,
              const Observe& observe) {
        if (!acts(step)) return false;
        bool changed = false;
        count_view(screen, g.means.size());
        if (grows(step)) {
            grow_and_prune(step, g);
            changed = rebuild(std::uint32_t(step), g, adam);
        }
        if (trims(step)) {
            trim(g, observe);
            Buffer<int, Device> before;
            if (changed) before.swap(parents_);
            const bool trimmed = rebuild(std::uint32_t(step), g, adam);
            if (changed) chain_parents(before, trimmed);
            changed |= trimmed;
        }
        if (resets_opacity(step))
            parallel_for(Device{}, g.size(),
                         ResetOpacityBody{options_.reset_opacity, logit(options_.reset_opacity),
                                          g.log_scales.span(), g.filter.span(), weights(),
                                          g.opacity_logits.span(),
                                          adam.first_moments().opacity_logits.span(),
                                          adam.second_moments().opacity_logits.span()});
        return changed;
    }

    /// Whether step() may add, remove or reorder splats at this step.
    bool may_change_structure(int step) const { return acts(step) && (grows(step) || trims(step)); }

    bool resets_opacity(int step) const {
        return acts(step) && step % options_.opacity_reset_every == 0;
    }

    void state(StateVisitor<Device>& visit) {
        visit("densify.statistics", statistics_);
        if (visit.loading() ? visit.has("densify.open") : !open_.empty())
            visit("densify.open", open_);
    }

    /// Old index of each splat, after a step that changed the structure.
    Span<const int> parents() const { return parents_.span(); }

private:
    bool acts(int step) const {
        return options_.enabled && options_.growth_in_gaps_only < 1 && step < options_.until;
    }

    bool grows(int step) const { return step > options_.from && step % options_.every == 0; }

    bool trims(int step) const {
        return options_.trim_min_views > 0 && step % options_.trim_every == 0;
    }

    GrowthWeights weights() const { return {open_.span(), options_.growth_in_gaps_only}; }

    static float logit(float opacity) { return std::log(opacity / (1 - opacity)); }

    /// Adds the statistics of one render to the sums since the last growth.
    void count_view(const ScreenStatistics<Device>& screen, std::size_t splats) {
        if (statistics_.size() != splats) {
            statistics_.resize(splats);
            statistics_.fill_zero();
        }
        parallel_for(Device{}, int(splats),
                     AccumulateBody{screen.radii_px.span(), screen.dL_dmeans2d.span(),
                                    screen.abs_dL_dmeans2d.span(), screen.front_pixels.span(),
                                    options_.rule, weights(), statistics_.span()});
    }

    /// Fills growth_ and counts_.
    void grow_and_prune(int step, const Gaussians<Device>& g) {
        const std::size_t n = g.means.size();
        growth_.resize(n), score_.resize(n), counts_.resize(n);
        const float infinite = 3e38f;
        const float abs_threshold = options_.rule == GrowthRule::quantile
                                        ? abs_quantile(statistics_, options_.gradient_threshold)
                                    : options_.max_abs_split > 0 ? options_.abs_gradient_threshold
                                                                 : infinite;
        parallel_for(Device{}, g.size(),
                     ProposeBody{options_.rule, statistics_.span(), g.log_scales.span(),
                                 options_.gradient_threshold, abs_threshold,
                                 options_.percent_dense * extent_, growth_.span(), score_.span()});
        apply_quotas(g.size());
        parallel_for(
            Device{}, g.size(),
            CountBody{growth_.span(), g.log_scales.span(), g.opacity_logits.span(),
                      logit(options_.min_opacity),
                      step > options_.prune_large_after ? options_.prune_large * extent_ : infinite,
                      weights(), counts_.span()});
        statistics_.resize(0);
    }

    /// Limits growth to the cap and the quota of abs_split: keeps the largest scores, of equal ones
    /// the lowest index. Runs on the host, as it is rare.
    void apply_quotas(int n) {
        std::vector<Growth> growth = to_host(growth_);
        const std::vector<float> score = to_host(score_);
        std::size_t room = options_.max_gaussians > n ? std::size_t(options_.max_gaussians - n) : 0;
        bool changed = false;
        for (Growth kind : {Growth::clone, Growth::split, Growth::abs_split}) {
            std::vector<int> chosen;
            for (int i = 0; i < n; ++i)
                if (growth[i] == kind) chosen.push_back(i);
            std::size_t quota = room;
            if (kind == Growth::abs_split)
                quota = std::min(quota, std::size_t(options_.max_abs_split));
            if (chosen.size() > quota) {
                const auto precedes = [&](int a, int b) {
                    return score[a] != score[b] ? score[a] > score[b] : a < b;
                };
                std::nth_element(chosen.begin(), chosen.begin() + std::ptrdiff_t(quota),
                                 chosen.end(), precedes);
                for (std::size_t j = quota; j < chosen.size(); ++j)
                    growth[chosen[j]] = Growth::none;
                changed = true;
            }
            room -= std::min(room, std::min(quota, chosen.size()));
        }
        if (changed) copy(growth, growth_);
    }

    template <class Observe>
    void trim(const Gaussians<Device>& g, const Observe& observe) {
        const std::size_t n = g.means.size();
        front_views_.resize(n), growth_.resize(n), counts_.resize(n);
        front_views_.fill_zero();
        observe([&](const ScreenStatistics<Device>& screen) {
            parallel_for(Device{}, int(n),
                         CountFrontViewsBody{screen.front_pixels.span(), front_views_.span()});
        });
        parallel_for(Device{}, g.size(),
                     KeepSeenBody{front_views_.span(), options_.trim_min_views, weights(),
                                  counts_.span(), growth_.span()});
    }

    /// Applies growth_ and counts_, and reorders the splats in memory. Returns false, and changes
    /// nothing, when no splat would remain.
    bool rebuild(std::uint32_t step, Gaussians<Device>& g, Adam<Device>& adam) {
        const int total = exclusive_scan(counts_, first_);
        if (total == 0) return false;
        const std::size_t n = total;
        parents_.resize(n), is_new_.resize(n), child_of_split_.resize(n);
        parallel_for(Device{}, g.size(),
                     SourceBody{growth_.span(), counts_.span(), first_.span(), parents_.span(),
                                is_new_.span(), child_of_split_.span()});
        // 1. The new geometry, which determines the place of each splat in memory.
        gather_arrays(true, parents_.span(), {}, g);
        parallel_for(
            Device{}, total,
            ScatterChildrenBody{is_new_.span(), child_of_split_.span(), options_.jitter_clones,
                                seed_, step, g.means.span(), g.log_scales.span(), g.quats.span()});
        parallel_for(Device{}, total, NormalizeQuatBody{g.quats.span()});
        // 2. Move all arrays to their new places; copy inherited values from the parents.
        morton_order(g.means.span(), first_);
        gather_arrays(true, first_.span(), {}, g);
        gather(first_.span(), {}, parents_, counts_);
        gather(first_.span(), {}, is_new_, child_of_split_);
        gather_arrays(false, parents_.span(), {}, g);
        if (!open_.empty()) gather(parents_.span(), {}, open_, scratch1_);
        // The moments move with their splats; those of new splats start with 0.
        for (Gaussians<Device>* moments : {&adam.first_moments(), &adam.second_moments()})
            for (const bool shapes : {true, false})
                gather_arrays(shapes, parents_.span(), is_new_.span(), *moments);
        statistics_.resize(0);
        return true;
    }

    /// Gathers the arrays that describe the splats' shapes, or all other arrays; see gather().
    void gather_arrays(bool shapes,
                       Span<const int> from,
                       Span<const std::uint8_t> cleared,
                       Gaussians<Device>& g) {
        for_each_array(
            [&](const SplatArray& array, auto& values) {
                if (array.shape == shapes && !values.empty())
                    gather(from, array.inherited ? cleared : is_new_.span(), values,
                           scratch_of(array, values), array.planes);
            },
            g);
    }

    /// Returns the scratch of a type, which gather() swaps with the array. SH coefficients have
    /// their own scratch; else small arrays would get their large buffers.
    auto& scratch_of(const SplatArray& array, const Buffer<Vec3f, Device>&) {
        return array.planes > 1 ? scratch_sh_ : scratch3_;
    }
    auto& scratch_of(const SplatArray&, const Buffer<Quatf, Device>&) { return scratch4_; }
    auto& scratch_of(const SplatArray&, const Buffer<float, Device>&) { return scratch1_; }

    /// parents_ <- before[parents_]: merges two structure changes of one step.
    void chain_parents(Buffer<int, Device>& before, bool trimmed) {
        if (!trimmed) return parents_.swap(before);
        gather(parents_.span(), {}, before, counts_);
        parents_.swap(before);
    }

    DensifyOptions options_;
    float extent_;
    std::uint64_t seed_;
    Buffer<GrowthStatistics, Device> statistics_;  // [N]; empty after each growth
    Buffer<float, Device> open_;                   // [N], or empty
    Buffer<Growth, Device> growth_;
    Buffer<float, Device> score_;
    Buffer<int, Device> counts_, first_, parents_, front_views_;
    Buffer<std::uint8_t, Device> is_new_, child_of_split_;
    Buffer<Vec3f, Device> scratch3_, scratch_sh_;
    Buffer<Quatf, Device> scratch4_;
    Buffer<float, Device> scratch1_;
};

}  // namespace tvsgs
