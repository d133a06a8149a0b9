// Runs growth, an Adam step and a trim with reset on either device, with the same random numbers.
#pragma once

#include "optim/growth/densify.h"
#include "support/random_gaussians.h"

namespace tvsgs::test {

struct DensifyResult {
    Gaussians<Cpu> gaussians, first_moments, second_moments;
    std::vector<int> parents;
};

/// With the rule `quantile` the splats also have a filter.
template <class Device>
DensifyResult densify_case(GrowthRule rule, float growth_in_gaps_only) {
    const int n = 1000;
    Random random(31);
    const auto draw = [&](double low, double high) {
        return static_cast<float>(random.uniform(low, high));
    };
    const auto screen = [&](std::size_t count) {
        std::vector<float> radii;
        std::vector<Vec2f> gradient, abs_gradient;
        std::vector<int> front;
        for (std::size_t i = 0; i < count; ++i) {
            radii.push_back(std::floor(draw(0, 40)));
            gradient.push_back({draw(-3e-4, 3e-4), draw(-3e-4, 3e-4)});
            abs_gradient.push_back({draw(0, 1e-3), draw(0, 1e-3)});
            front.push_back(static_cast<int>(draw(0, 3)));
        }
        ScreenStatistics<Device> s;
        copy(radii, s.radii_px);
        copy(gradient, s.dL_dmeans2d);
        copy(abs_gradient, s.abs_dL_dmeans2d);
        copy(front, s.front_pixels);
        return s;
    };
    Gaussians<Device> g;
    copy(random_gaussians(n, 30, 0.08, 2), g);
    if (rule == GrowthRule::quantile) copy(std::vector<float>(n, 0.02f), g.filter);
    copy(std::vector<float>(n, 0.5f), g.uncertainty);
    Adam<Device> adam({}, g);
    DensifyOptions options;
    options.rule = rule;
    options.max_abs_split = 30;
    options.percent_dense = 0.08f;
    options.growth_in_gaps_only = growth_in_gaps_only;
    Densifier<Device> densifier(options, 1, 7);
    if (growth_in_gaps_only > 0) {
        std::vector<float> open;
        for (int i = 0; i < n; ++i) open.push_back(static_cast<float>(i % 3) / 2);
        densifier.set_open(open);
    }
    const auto adam_step = [&](int step) {
        Gaussians<Device> gradients;
        copy(random_gaussians(g.size(), 32, 0.08, 2), gradients);
        adam.step(step, 1, 1, gradients, g, true);
    };
    adam_step(599);
    densifier.step(600, screen(g.means.size()), g, adam, [](const auto&) {});
    adam_step(601);
    densifier.step(3000, screen(g.means.size()), g, adam, [&](const auto& count_view) {
        for (int view = 0; view < 3; ++view) count_view(screen(g.means.size()));
    });
    DensifyResult result;
    copy(g, result.gaussians);
    copy(adam.first_moments(), result.first_moments);
    copy(adam.second_moments(), result.second_moments);
    result.parents.resize(densifier.parents().count);
    detail::copy(Device{}, densifier.parents().data, Cpu{}, result.parents.data(),
                 result.parents.size() * sizeof(int));
    return result;
}

/// densify_case<Cuda>, compiled by nvcc.
DensifyResult densify_case_cuda(GrowthRule rule, float growth_in_gaps_only);

}  // namespace tvsgs::test
