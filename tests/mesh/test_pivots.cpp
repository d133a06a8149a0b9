// Tests the points of the tetrahedra.
#include <gtest/gtest.h>

#include <algorithm>

#include "core/error.h"
#include "mesh/splat_surfaces.h"
#include "mesh/tetrahedra/mesher_tetrahedra.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::Random;

std::optional<Pivots> some_pivots(const FieldSplats<Cpu>& splats,
                                  const std::vector<float>& footprints,
                                  float grain,
                                  std::size_t most) {
    return surface_pivots(splats, pivot_splats(splats, footprints, 0.5f), footprints, grain, most);
}

TEST(Pivots, ComeOfTheMoreOpaqueHalfAtLeast) {
    Gaussians<Cpu> g;
    resize(g, 7, 0);
    FieldSplats<Cpu> splats = field_splats(g);
    const std::vector<float> footprints{1, 1, 1, 1, 1, 1, 0};  // the last one is in no image
    const auto chosen = [&](const std::vector<float>& opacities) {
        for (std::size_t i = 0; i < 7; ++i) splats.opacities[i] = opacities[i];
        std::vector<int> of = pivot_splats(splats, footprints, 0.5f);
        std::sort(of.begin(), of.end());
        return of;
    };
    EXPECT_EQ(chosen({.9f, .1f, .8f, .6f, .2f, .7f, .9f}), (std::vector<int>{0, 2, 3, 5}));
    EXPECT_EQ(chosen({.3f, .1f, .2f, .15f, .05f, .4f, .9f}), (std::vector<int>{0, 2, 5}));
}

TEST(Pivots, LieOnBothSidesOfTheSplat) {
    Gaussians<Cpu> g;
    resize(g, 3, 0);
    const Vec3d n = normalize(Vec3d{1, 2, 2});
    test::set_flat_splat(g, 0, {0.1, 0, 0}, n, 0.2, 0.05);
    test::set_flat_splat(g, 1, {0, 0.3, 0.2}, n, 0.2, 1e-6);  // thinner than a pixel
    test::set_flat_splat(g, 2, {0, 0, 20}, n, 0.2, 0.05);     // in no image
    g.opacity_logits[1] = 0.1f;
    std::vector<View> views{test::view_from({0, 0, 3}, 100), test::view_from({0, 0, -2}, 100)};
    FieldSplats<Cpu> splats = field_splats(g);
    const FieldViews field{views, true, 0.2f};
    DepthRules rules;
    rules.depth_max = 10;
    const auto footprints = pixel_footprints(splats, field, rules);
    EXPECT_FLOAT_EQ(footprints[0], 2.0f / 100);  // of the nearest view
    EXPECT_FLOAT_EQ(footprints[1], 2.2f / 100);
    EXPECT_EQ(footprints[2], 0);
    auto found = some_pivots(splats, footprints, 1, 100);
    ASSERT_TRUE(found);
    ASSERT_EQ(found->size(), 4u);
    const double deviations[] = {0.05, 0.022 / 4};
    for (std::size_t i = 0; i < 4; ++i) {
        const int splat = found->splats[i];
        const Vec3d d = vec_cast<double>(found->positions[i] - g.means[std::size_t(splat)]);
        EXPECT_NEAR(std::abs(dot(d, n)), 3 * deviations[splat], 1e-6);
        EXPECT_NEAR(norm(cross(d, n)), 0, 1e-6);
        EXPECT_NEAR(found->radii[i], 0.6, 1e-3);
    }
    EXPECT_LT(dot(found->positions[0] - g.means[std::size_t(found->splats[0])],
                  found->positions[1] - g.means[std::size_t(found->splats[1])]),
              0);

    EXPECT_FALSE(some_pivots(splats, footprints, 1, 3));

    // Smaller than a pixel: its two points are still neighbours.
    splats.scales[1] = {1e-4f, 1e-4f, 1e-5f};
    found = some_pivots(splats, footprints, 1, 100);
    for (std::size_t i = 0; i < 4; ++i)
        EXPECT_NEAR(found->radii[i], found->splats[i] == 1 ? 3 * 0.022 / 4 : 0.6, 1e-3);

    splats.opacities[0] = 0.1f;
    EXPECT_EQ(some_pivots(splats, footprints, 1, 100)->size(), 2u);

    // Masks and boxes exclude.
    views[0].mask = views[1].mask = ImageU8(100, 100, 1, 0);
    EXPECT_EQ(pixel_footprints(splats, field, rules)[0], 0);
    EXPECT_GT(pixel_footprints(splats, {views, false, 0.2f}, rules)[0], 0);
    views[0].mask = views[1].mask = {};
    rules.depth_max = 2.5f;
    EXPECT_FLOAT_EQ(pixel_footprints(splats, field, rules)[0], 2.0f / 100);
    rules.depth_max = 1.5f;
    EXPECT_EQ(pixel_footprints(splats, field, rules)[0], 0);
    rules.depth_max = 10, rules.has_box = true;
    rules.box_min = {-1, -1, -1}, rules.box_max = {0.05f, 1, 1};
    EXPECT_EQ(pixel_footprints(splats, field, rules)[0], 0);
    EXPECT_GT(pixel_footprints(splats, field, rules)[1], 0);
}

TEST(Pivots, OfACellTheFirstStays) {
    Gaussians<Cpu> g;
    resize(g, 200, 0);
    for (int i = 0; i < 200; ++i)  // 100 places, each twice
        test::set_flat_splat(g, i, {0.02 * (i / 2), 1e-7 * (i % 2), 0}, {0, 0, 1}, 0.1, 0.01);
    const auto splats = field_splats(g);
    const std::vector<float> footprints(200, 0.01f);
    const auto all = some_pivots(splats, footprints, 1e-9f, 1000);
    EXPECT_EQ(all->size(), 400u);
    EXPECT_EQ(some_pivots(splats, footprints, 1, 1000)->size(), 200u);
    const auto few = some_pivots(splats, footprints, 64, 1000);
    EXPECT_EQ(few->size(), 32u);  // cells of 1/8 on a line of 2
    for (const float radius : few->radii) EXPECT_NEAR(radius, 0.3, 0.01);  // three deviations
    const auto fewer = some_pivots(splats, footprints, 256, 1000);
    EXPECT_EQ(fewer->size(), 8u);
    for (const float radius : fewer->radii) EXPECT_NEAR(radius, 0.64, 0.01);  // a cell
}

TEST(Pivots, GridKeepsPlacesAndAddsABox) {
    Gaussians<Cpu> g = test::sphere_splats(300, 1, 0.05);
    g.log_scales[7] = {9, 9, 9};  // its points are thousands of units away
    const auto splats = field_splats(g);
    auto pivots = *some_pivots(splats, std::vector<float>(300, 0.01f), 1, 1000);
    const Pivots before = pivots;
    const auto grid = snap_to_grid(splats, {}, pivots);
    ASSERT_EQ(pivots.size(), before.size() - 2 + 8);
    ASSERT_EQ(grid.size(), pivots.size());
    for (std::size_t i = 0, k = 0; i < before.size(); ++i) {
        if (before.splats[i] == 7) continue;
        EXPECT_LT(norm(before.positions[i] - pivots.positions[k]), 8.0f / (1 << 24));
        EXPECT_EQ(before.splats[i], pivots.splats[k]);
        EXPECT_EQ(before.radii[i], pivots.radii[k]);
        ++k;
    }
    EXPECT_NEAR(norm(pivots.positions.back()), 4 * std::sqrt(3.0), 0.1);
    EXPECT_EQ(pivots.splats.back(), -1);
    EXPECT_EQ(pivots.radii.back(), 0);

    // Contracted, the far points are nearer on the grid, and the box lies beyond the contracted
    // world.
    g.log_scales[7] = g.log_scales[8];
    for (int i = 0; i < 100; ++i) g.means[std::size_t(i)] = 50.0f * g.means[std::size_t(i)];
    const auto wide = field_splats(g);
    pivots = *some_pivots(wide, std::vector<float>(300, 0.01f), 1, 1000);
    const Pivots far = pivots;
    const auto contracted = snap_to_grid(wide, {{0, 0, 0}, 1.5}, pivots);
    ASSERT_EQ(contracted.size(), far.size() + 8);
    for (std::size_t i = 0; i < far.size(); ++i)
        EXPECT_LT(norm(far.positions[i] - pivots.positions[i]), 0.01f);
    EXPECT_FALSE(is_finite(pivots.positions.back()));
    // All in one point: no extent.
    Pivots one{{{0, 0, 0}}, {1}, {3}};
    EXPECT_TRUE(snap_to_grid(splats, {}, one).empty());
}

}  // namespace
}  // namespace tvsgs
