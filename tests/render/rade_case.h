// Helpers of the tests of the backbone `rade`.
#pragma once

#include <algorithm>
#include <vector>

#include "render/backbone.h"
#include "support/random_gaussians.h"

namespace tvsgs::test {

inline constexpr Maps kAllRadeMaps = Maps::color | kGeometryMaps | Maps::expected_depth;

inline BackboneOptions with_depth(SurfaceDepth depth) {
    BackboneOptions options;
    options.depth = depth;
    return options;
}

/// With filters from zero to the splats' own size.
inline Gaussians<Cpu> filtered_gaussians(int count, unsigned seed, double size) {
    Gaussians<Cpu> g = random_gaussians(count, seed, size);
    Random random(seed + 1);
    g.filter.resize(g.means.size());
    for (std::size_t i = 0; i < g.means.size(); ++i)
        g.filter[i] = i % 4 == 0 ? 0 : static_cast<float>(random.uniform(0, size));
    return g;
}

/// Weights of all maps.
inline ImageGradients<Cpu> weights_of_maps(std::size_t pixels) {
    Random random(3);
    std::vector<Vec3f> color, normal;
    std::vector<float> depth, expected;
    for (std::size_t p = 0; p < pixels; ++p) {
        color.push_back(vec_cast<float>(random.normal3()));
        normal.push_back(vec_cast<float>(random.normal3()));
        depth.push_back(static_cast<float>(random.uniform(-1, 1)));
        expected.push_back(static_cast<float>(random.uniform(-1, 1)));
    }
    ImageGradients<Cpu> g;
    copy(color, g.color), copy(normal, g.normal), copy(depth, g.depth);
    copy(expected, g.expected_depth);
    return g;
}

}  // namespace tvsgs::test
