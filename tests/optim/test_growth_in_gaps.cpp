// Open shares of a cloud, and growth that is limited to open places.
#include <array>

#include "densify_case.h"
#include "densify_model.h"
#include "optim/views/matchable.h"
#include "training_scene.h"

namespace tvsgs {
namespace {

using test::kNoViews;
using test::Model;
using test::options_without_trim;
using test::parents_of;

/// Two views of the plane z = 0 from nearly the same place, textured except for x > `flat_from`; a
/// pixel is 0.02 units there.
std::vector<View> views_of_a_plane(int flat_from = 200) {
    std::vector<View> views(2);
    for (std::size_t v = 0; v < 2; ++v) {
        views[v].camera = {200, 160, 200, 200, 100, 80, {}};
        views[v].camera.camera_from_world.t = {0.001f * static_cast<float>(v), 0, 4};
        views[v].photo = ImageU8(200, 160, 3, 128);
        for (int y = 0; y < 160; ++y)
            for (int x = 0; x < flat_from; ++x)
                for (int c = 0; c < 3; ++c)
                    views[v].photo.at(x, y, c) = static_cast<std::uint8_t>(x / 4 % 2 ? 90 : 160);
    }
    return views;
}

/// Points at every `step`-th pixel along both axes, from x = 0 to `to` px, except inside `hole`.
template <class Hole>
std::vector<Vec3f> plane_points(int step, int to, const Hole& hole) {
    std::vector<Vec3f> points;
    for (int y = 0; y < 160; y += step)
        for (int x = 0; x < to; x += step)
            if (!hole(x, y))
                points.push_back({(static_cast<float>(x) + 0.5f - 100) * 0.02f,
                                  (static_cast<float>(y) + 0.5f - 80) * 0.02f, 0});
    return points;
}
constexpr auto kNoHole = [](int, int) { return false; };
int x_of(Vec3f point) {
    return static_cast<int>(std::lround(point.x / 0.02f + 99.5f));
}
int y_of(Vec3f point) {
    return static_cast<int>(std::lround(point.y / 0.02f + 79.5f));
}

TEST(OpenShares, AreNoneWhereTheCloudCoversAndAllWhereItDoesNot) {
    // A point per pixel; then one per 25 pixels, 0.04 per pixel.
    for (const float open : open_shares(views_of_a_plane(), plane_points(1, 200, kNoHole), false))
        ASSERT_EQ(open, 0);
    const auto sparse = plane_points(10, 200, kNoHole);
    for (const float open : open_shares(views_of_a_plane(), sparse, false)) ASSERT_EQ(open, 1);
    // One per 16 pixels: 17 of 32 of the way from 0.02 to 0.1.
    for (const float open : open_shares(views_of_a_plane(), plane_points(4, 200, kNoHole), false))
        ASSERT_NEAR(open, 15 / 32., 1e-6);
}

TEST(OpenShares, GoByWhatCouldBeMatched) {
    std::vector<View> views = views_of_a_plane();
    for (View& view : views) {  // half of each block
        view.mask = ImageU8(200, 160, 1);
        for (int y = 0; y < 160; ++y)
            for (int x = 0; x < 200; ++x) view.mask.at(x, y) = x % 8 < 4 ? 255 : 0;
    }
    const auto points = plane_points(4, 200, [](int x, int) { return x % 8 >= 4; });
    for (const float open : open_shares(views, points, true)) ASSERT_NEAR(open, 15 / 64., 1e-6);
}

TEST(OpenShares, AreThoseOfTheSplatsAroundAGap) {
    const auto points =
        plane_points(1, 200, [](int x, int y) { return x >= 80 && x < 128 && y >= 64 && y < 112; });
    const std::vector<float> open = open_shares(views_of_a_plane(), points, false);
    int around = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const int x = x_of(points[i]), y = y_of(points[i]);
        const int away = std::max({80 - x, x - 127, 64 - y, y - 111});
        // Blocks beside the gap include its covered edge; blocks behind these do not.
        around += away <= 8;
        if (away <= 8)
            EXPECT_EQ(open[i], 1) << x << " " << y;
        else
            EXPECT_EQ(open[i], 0) << x << " " << y;
    }
    EXPECT_EQ(around, 64 * 64 - 48 * 48);
}

TEST(OpenShares, NeitherFlatPlacesNorRimsNorWhatMasksLeaveOutAreOpen) {
    // Texture and cloud end at the same place: five pixels beyond still count as textured.
    for (const int edge : {96, 99, 102})
        for (const float open :
             open_shares(views_of_a_plane(edge), plane_points(1, edge, kNoHole), false))
            ASSERT_EQ(open, 0) << edge;
    const auto half = plane_points(1, 100, kNoHole);
    std::vector<View> views = views_of_a_plane();
    const auto largest = [&](bool masks) {
        const std::vector<float> open = open_shares(views, half, masks);
        return *std::max_element(open.begin(), open.end());
    };
    EXPECT_EQ(largest(true), 1) << "there are no masks";
    for (View& view : views) {
        view.mask = ImageU8(200, 160, 1);
        for (int y = 0; y < 160; ++y)
            for (int x = 0; x < 100; ++x) view.mask.at(x, y) = 255;
    }
    EXPECT_EQ(largest(true), 0);
    EXPECT_EQ(largest(false), 1) << "masks that are not used";
    EXPECT_TRUE(open_shares(views, {}, true).empty());
    EXPECT_EQ(open_shares(views, {{0, 0, -100}}, true), (std::vector<float>{0}))
        << "what no view sees has nothing open beside it";
}

TEST(GrowthInGaps, WeighsWhatDecidesAboutEachSplat) {
    DensifyOptions o = options_without_trim();
    o.growth_in_gaps_only = 0.5f;  // the weights are 0.5, 0.625, 0.75
    const std::vector<float> open{0, 0.5f, 1};
    const float t = o.gradient_threshold;
    const auto parents = [&](const auto& change) {
        Model model(3);
        for (std::size_t i = 0; i < 3; ++i) change(model, i);
        Densifier<Cpu> densifier(o, 1, 0);
        densifier.set_open(open);
        densifier.step(3100, model.screen, model.g, model.adam, kNoViews);
        return parents_of(densifier);
    };
    EXPECT_EQ(parents([&](Model& m, std::size_t i) {
                  m.screen.dL_dmeans2d[i] = {1.4f * t, 0};
              }),
              (std::vector<int>{0, 1, 2, 2}));
    EXPECT_EQ(parents([&](Model& m, std::size_t i) {
                  m.screen.dL_dmeans2d[i] = {1.7f * t, 0};
              }),
              (std::vector<int>{0, 1, 1, 2, 2}));
    EXPECT_EQ(parents([&](Model& m, std::size_t i) {
                  m.screen.dL_dmeans2d[i] = {2.1f * t, 0};
              }),
              (std::vector<int>{0, 0, 1, 1, 2, 2}));
    // Pruned below opacities of 0.0025, 0.0031 and 0.0038; above scales of 0.2, 0.16, 0.133.
    const auto faint = [&](float opacity) {
        return parents([&](Model& m, std::size_t i) {
            m.g.opacity_logits[i] = std::log(opacity / (1 - opacity));
        });
    };
    EXPECT_EQ(faint(0.0037f), (std::vector<int>{0, 1}));
    EXPECT_EQ(faint(0.0030f), (std::vector<int>{0}));
    EXPECT_EQ(parents([](Model& m, std::size_t i) { m.g.log_scales[i].y = std::log(0.15f); }),
              (std::vector<int>{0, 1}));
    EXPECT_EQ(parents([](Model& m, std::size_t i) { m.g.log_scales[i].y = std::log(0.17f); }),
              (std::vector<int>{0}));
}

TEST(GrowthInGaps, TrimsAndResetsByDegrees) {
    DensifyOptions o = options_without_trim();
    o.growth_in_gaps_only = 0.5f,
    o.trim_min_views = 2;  // times the weights: 1, 1.25, 1.5, 1.5 views
    Model model(4);
    for (std::size_t i = 0; i < 4; ++i) model.g.opacity_logits[i] = 3;
    Densifier<Cpu> densifier(o, 1, 0);
    densifier.set_open({0, 0.5f, 1, 1});
    densifier.step(3000, model.screen, model.g, model.adam, [&](const auto& count_view) {
        for (const auto& view : {std::array{1, 1, 1, 0}, std::array{0, 0, 1, 1}}) {
            for (std::size_t i = 0; i < 4; ++i) model.screen.front_pixels[i] = view[i];
            count_view(model.screen);
        }
    });
    ASSERT_EQ(parents_of(densifier), (std::vector<int>{0, 2}));
    const auto opacity = [&](std::size_t i) {
        return 1 / (1 + std::exp(-model.g.opacity_logits[i]));
    };
    EXPECT_NEAR(opacity(0), 1 - 0.5 * 0.99, 1e-5);
    EXPECT_NEAR(opacity(1), 1 - 0.75 * 0.99, 1e-5);
}

TEST(GrowthInGaps, ChildrenInheritWhatIsOpen) {
    DensifyOptions o = options_without_trim();
    o.growth_in_gaps_only = 0.5f;
    Model model(3);
    Densifier<Cpu> densifier(o, 1, 0);
    densifier.set_open({0, 1, 0});
    for (const std::size_t count : {4u, 6u}) {  // 0 1 1 2, then 0 1 1 1 1 2
        model.show();
        for (std::size_t i = 0; i < model.g.means.size(); ++i)
            model.screen.dL_dmeans2d[i] = {1.7f * o.gradient_threshold, 0};
        densifier.step(600, model.screen, model.g, model.adam, kNoViews);
        EXPECT_EQ(model.g.means.size(), count);
    }
    State state;
    StateVisitor<Cpu> saving(state);
    densifier.state(saving);
    Densifier<Cpu> resumed(o, 1, 0);
    StateVisitor<Cpu> loading(std::as_const(state));
    resumed.state(loading);
    model.show();
    for (std::size_t i = 0; i < model.g.means.size(); ++i)
        model.screen.dL_dmeans2d[i] = {1.7f * o.gradient_threshold, 0};
    resumed.step(600, model.screen, model.g, model.adam, kNoViews);
    EXPECT_EQ(model.g.means.size(), 10u) << "0, eight of 1, 2";
    o.growth_in_gaps_only = 1;
    const Densifier<Cpu> covered(o, 1, 0);
    EXPECT_FALSE(covered.may_change_structure(600) || covered.resets_opacity(3000));
}

/// Splats after a training from these initial points, with everything on.
std::vector<Vec3f> trained(const Scene& scene, bool grows, float growth_in_gaps_only) {
    TrainOptions o = test::everything_on(34);
    o.densify.enabled = grows, o.densify.growth_in_gaps_only = growth_in_gaps_only;
    return to_host(train<Cpu>(scene, o, {}).means);
}
bool same(const std::vector<Vec3f>& a, const std::vector<Vec3f>& b) {
    return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), [](Vec3f p, Vec3f q) {
               return p.x == q.x && p.y == q.y && p.z == q.z;
           });
}

TEST(GrowthInGaps, EndsAreNoGrowthAndTheUsualOne) {
    const Scene scene = test::rendered_scene();
    const auto none = trained(scene, false, 0), usual = trained(scene, true, 0),
               half = trained(scene, true, 0.5f);
    EXPECT_TRUE(same(trained(scene, true, 1), none));
    EXPECT_FALSE(same(half, none) || same(half, usual) || same(usual, none));
}

}  // namespace
}  // namespace tvsgs
