// Hand-made splats and screen statistics for the tests of growing and pruning.
#pragma once

#include "optim/growth/densify.h"
#include "support/random_gaussians.h"

namespace tvsgs::test {

inline constexpr float kLogSmall = -3, kLogLarge = -1;

/// A row of equal round splats, so that new splats stay next to their parents; an optimiser with
/// moments of 1; and the statistics of the last view.
struct Model {
    explicit Model(int count) : g(random_gaussians(count, 1, 0.1, 1)), adam({}, g) {
        const auto n = static_cast<std::size_t>(count);
        for (std::size_t i = 0; i < n; ++i) {
            g.means[i] = {100 * static_cast<float>(i), 0, 0};
            g.log_scales[i] = {kLogSmall, kLogSmall, kLogSmall};
            g.quats[i] = {1, 0, 0, 0};
            g.opacity_logits[i] = 0;
        }
        for (Gaussians<Cpu>* moments : {&adam.first_moments(), &adam.second_moments()}) {
            for (auto* buffer : {&moments->means, &moments->log_scales, &moments->sh})
                std::fill(buffer->data(), buffer->data() + buffer->size(), Vec3f{1, 1, 1});
            for (std::size_t i = 0; i < n; ++i)
                moments->quats[i] = {1, 1, 1, 1}, moments->opacity_logits[i] = 1;
        }
        show();
    }

    /// Sizes the statistics to the splats: all visible in front, radius 5, no gradient.
    void show() {
        const std::size_t n = g.means.size();
        screen.radii_px.resize(n), screen.dL_dmeans2d.resize(n);
        screen.abs_dL_dmeans2d.resize(n), screen.front_pixels.resize(n);
        for (std::size_t i = 0; i < n; ++i) {
            screen.radii_px[i] = 5, screen.front_pixels[i] = 1;
            screen.dL_dmeans2d[i] = screen.abs_dL_dmeans2d[i] = {0, 0};
        }
    }
    void large(std::size_t i) { g.log_scales[i] = {kLogSmall, kLogLarge, kLogSmall}; }

    Gaussians<Cpu> g;
    Adam<Cpu> adam;
    ScreenStatistics<Cpu> screen;
};

/// Clones splats up to a size between the two at extent 1; no trim.
inline DensifyOptions options_without_trim() {
    DensifyOptions o;
    o.percent_dense = std::exp(-2.0f);
    o.trim_min_views = 0;
    return o;
}

inline constexpr auto kNoViews = [](const auto&) {};

inline std::vector<int> parents_of(const Densifier<Cpu>& densifier) {
    const Span<const int> p = densifier.parents();
    return {p.begin(), p.end()};
}

/// One step of a fresh densifier at iteration 600.
inline std::vector<int> grow_once(Model& model, const DensifyOptions& options, float extent = 1) {
    Densifier<Cpu> densifier(options, extent, 0);
    const bool changed = densifier.step(600, model.screen, model.g, model.adam, kNoViews);
    EXPECT_TRUE(changed);
    EXPECT_EQ(model.g.means.size(), densifier.parents().count);
    EXPECT_EQ(model.adam.first_moments().sh.size(), model.g.sh.size());
    return parents_of(densifier);
}

}  // namespace tvsgs::test
