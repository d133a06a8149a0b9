// Priors from stereo: made from known surfaces, and from real stereo.
#include <algorithm>

#include "core/scene/prior_maps.h"
#include "mvs/analytic_scene.h"
#include "pipeline/priors/stereo_priors.h"
#include "pipeline/run/run_options.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

const MapNames kAll{prior_map::kDepth, prior_map::kDepthOrder, prior_map::kConfidence,
                    prior_map::kNormal};

const std::vector<float>& values(const View& view, std::string_view name) {
    for (const ViewMap& map : view.maps)
        if (map.name == name) return map.values;
    throw Error(ExitCode::internal, str("no map ", name));
}

double grey(const test::Surface& s) {
    return s.is_ball ? 0.8 : 0.2 + 0.2 * test::noise(3.0 * s.point);
}

Vec3d normal_in_camera(const Camera& camera, const test::Surface& s) {
    return mat_cast<double>(camera.camera_from_world.R) * s.normal;
}

/// The true maps of a view in another size, known where `known(x, y)` is true.
template <class Known>
StereoMaps true_maps(const Camera& of, int width, int height, const Known& known) {
    StereoMaps maps{scaled_camera(of, width, height), {}, {}, {}};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const test::Surface s = test::trace(maps.camera, x + 0.5, y + 0.5);
            const bool has = s.depth > 0 && known(x, y);
            maps.depth.push_back(has ? static_cast<float>(s.depth) : 0);
            maps.normals.push_back(has ? vec_cast<float>(normal_in_camera(of, s)) : Vec3f{});
            maps.confidence.push_back(has ? 0.5f : 0);
        }
    return maps;
}

constexpr int kWidth = 160, kHeight = 120;
const auto kHoles = [](int x, int y) { return !(x > 100 && y > 20 && y < 90) && (x + y) % 3 != 0; };

View ball_view() {
    return test::photograph(test::arc_camera(kWidth, kHeight, 0.1), grey);
}

TEST(StereoPriors, MeasuredFilledAndNothingAreToldApart) {
    std::vector<View> views{ball_view()};
    const StereoMaps stereo = true_maps(views[0].camera, kWidth, kHeight, kHoles);
    add_stereo_priors(completed_maps({stereo}, views), kAll, views);
    ASSERT_EQ(views[0].maps.size(), 4u);
    const auto &depth = values(views[0], "depth"), &confidence = values(views[0], "confidence"),
               &order = values(views[0], "depth_order"), &normal = values(views[0], "normal");
    int planar = 0, filled = 0, near = 0;
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const auto at = static_cast<std::size_t>(y * kWidth + x);
            const Vec3f n{normal[3 * at], normal[3 * at + 1], normal[3 * at + 2]};
            const test::Surface truth = test::trace(views[0].camera, x + 0.5, y + 0.5);
            ASSERT_GT(depth[at], 0);
            EXPECT_FALSE(std::isnan(order[at]));
            if (stereo.depth[at] > 0) {
                EXPECT_EQ(depth[at], stereo.depth[at]);
                EXPECT_FLOAT_EQ(confidence[at], 0.1f + 0.9f * 0.5f);
                EXPECT_GT(dot(vec_cast<double>(n), normal_in_camera(views[0].camera, truth)), 0.95);
                EXPECT_NEAR(norm(n), 1, 1e-5);
            } else {
                EXPECT_LE(confidence[at], kPlanarConfidence);
                EXPECT_EQ(norm(n) > 0, confidence[at] == kPlanarConfidence);
                (confidence[at] == kPlanarConfidence ? planar : filled) += 1;
                near += std::abs(double(depth[at]) - truth.depth) < 0.05 * truth.depth;
            }
        }
    EXPECT_GT(planar, 2000);
    EXPECT_GT(filled, 20);
    EXPECT_GT(near, 0.9 * (planar + filled));
}

TEST(StereoPriors, TheOrderIsDepthStretched) {
    std::vector<View> views{ball_view()};
    const StereoMaps stereo = true_maps(views[0].camera, kWidth, kHeight, kHoles);
    add_stereo_priors(completed_maps({stereo}, views), kAll, views);
    const auto &depth = values(views[0], "depth"), &order = values(views[0], "depth_order");
    std::vector<float> measured;
    int below = 0, above = 0;
    for (std::size_t i = 0; i < depth.size(); ++i)
        if (stereo.depth[i] > 0)
            measured.push_back(order[i]), below += order[i]<0, above += order[i]> 1;
    const double share = 0.02 * static_cast<double>(measured.size());
    EXPECT_NEAR(below, share, 2);
    EXPECT_NEAR(above, share, 2);
    // Affine: three pixels have the same ratio.
    const double a = double(order[500]) - double(order[100]),
                 b = double(order[9000]) - double(order[100]);
    EXPECT_NEAR(a * (double(depth[9000]) - double(depth[100])),
                b * (double(depth[500]) - double(depth[100])), 1e-4);
    EXPECT_GT(b / (double(depth[9000]) - double(depth[100])), 0);
}

TEST(StereoPriors, AHalvedStereoGivesSurfacesWithoutSteps) {
    const auto wall_only = [](const test::Surface&) { return 0.5; };
    Camera camera = test::arc_camera(2 * kWidth, 2 * kHeight, 0.1);
    std::vector<View> views{test::photograph(camera, wall_only)};
    add_stereo_priors(
        completed_maps({true_maps(camera, kWidth, kHeight, [](int, int) { return true; })}, views),
        kAll, views);
    for (const ViewMap& map : views[0].maps) {
        EXPECT_EQ(map.width_px, 2 * kWidth);
        EXPECT_EQ(map.height_px, 2 * kHeight);
        EXPECT_EQ(map.values.size(), std::size_t(4 * kWidth * kHeight * map.channels));
    }
    const auto& depth = values(views[0], "depth");
    int checked = 0;
    for (int y = 0; y < 2 * kHeight; ++y)
        for (int x = 0; x < 2 * kWidth; ++x) {
            bool wall = true;
            for (int k = 0; k < 9; ++k)
                wall &= !test::trace(camera, x + 0.5 + 6 * (k % 3 - 1), y + 0.5 + 6 * (k / 3 - 1))
                             .is_ball;
            if (!wall) continue;
            ++checked;
            const double truth = test::trace(camera, x + 0.5, y + 0.5).depth;
            ASSERT_NEAR(depth[static_cast<std::size_t>(y * 2 * kWidth + x)], truth, 1e-4 * truth);
        }
    EXPECT_GT(checked, 1000);
}

TEST(StereoPriors, NothingBeyondTheMask) {
    std::vector<View> views{ball_view()};
    views[0].mask = ImageU8(kWidth, kHeight, 1, 255);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < 40; ++x) views[0].mask.at(x, y) = 0;
    const auto known = [](int x, int y) { return x >= 40 && kHoles(x, y); };
    add_stereo_priors(completed_maps({true_maps(views[0].camera, kWidth, kHeight, known)}, views),
                      kAll, views);
    for (int at = 0; at < kWidth * kHeight; ++at) {
        const auto i = static_cast<std::size_t>(at);
        EXPECT_EQ(values(views[0], "depth")[i] > 0, at % kWidth >= 40) << at;
        EXPECT_EQ(values(views[0], "confidence")[i] > 0, at % kWidth >= 40) << at;
    }
}

TEST(StereoPriors, OnlyWhatIsWantedAndMissing) {
    std::vector<View> views{ball_view(), ball_view(), ball_view()};
    views[1].maps.push_back({"depth_order", 1, 1, 1, {0.5f}});
    views[2].maps.push_back({"features", 1, 1, 1, {0.5f}});
    const StereoMaps stereo = true_maps(views[0].camera, kWidth, kHeight, kHoles);
    StereoMaps none = true_maps(views[0].camera, kWidth, kHeight, [](int, int) { return false; });
    add_stereo_priors(completed_maps({stereo, stereo, stereo}, views),
                      {"normal", "features", "mask"}, views);
    ASSERT_EQ(views[0].maps.size(), 1u);
    EXPECT_EQ(views[0].maps[0].name, "normal");
    EXPECT_EQ(views[0].maps[0].channels, 3);
    ASSERT_EQ(views[1].maps.size(), 2u);
    EXPECT_EQ(views[1].maps[1].name, "normal");
    EXPECT_EQ(views[2].maps.size(), 2u);
    add_stereo_priors(completed_maps({stereo, stereo, stereo}, views), kAll, views);
    EXPECT_EQ(views[1].maps.size(), 2u) << "its order came with it, and its normals are there";
    std::vector<View> blind{ball_view()};
    add_stereo_priors(completed_maps({none}, blind), kAll, blind);
    EXPECT_TRUE(blind[0].maps.empty());
}

TEST(StereoPriors, AddsWhatAViewCameWithout) {
    std::vector<View> views{ball_view()};
    const StereoMaps stereo = true_maps(views[0].camera, kWidth, kHeight, kHoles);
    const std::vector<float> given(std::size_t(kWidth) * kHeight, 7.0f);
    views[0].maps.push_back({"depth", kWidth, kHeight, 1, given});
    add_stereo_priors(completed_maps({stereo}, views), kAll, views);
    ASSERT_EQ(views[0].maps.size(), 2u) << "no order or confidence that is another depth's";
    EXPECT_EQ(values(views[0], "depth"), given);
    EXPECT_EQ(views[0].maps[1].name, "normal");
    // A confidence without its depth.
    views = {ball_view()};
    views[0].maps.push_back({"confidence", kWidth, kHeight, 1, given});
    add_stereo_priors(completed_maps({stereo}, views), kAll, views);
    ASSERT_EQ(views[0].maps.size(), 4u);
    EXPECT_LE(values(views[0], "confidence")[0], 1);
}

TEST(StereoPriors, AWallMetHeadOnHasAnOrder) {
    std::vector<View> views{ball_view()};
    StereoMaps flat = true_maps(views[0].camera, kWidth, kHeight, [](int, int) { return true; });
    std::fill(flat.depth.begin(), flat.depth.end(), 4.0f);
    std::fill(flat.normals.begin(), flat.normals.end(), Vec3f{0, 0, -1});
    add_stereo_priors(completed_maps({flat}, views), kAll, views);
    for (const float v : values(views[0], "depth_order")) ASSERT_EQ(v, 0);
}

double textured(const test::Surface& surface) {
    return test::texture(surface.point);
}

/// The whole way from photographs to maps.
TEST(StereoPriors, OfRealStereoAreNearTheTruth) {
    std::vector<View> views = test::arc_views(3, textured, kWidth, kHeight);
    RunOptions options;
    options.train.loss.prior_depth.weight = options.train.loss.relative_depth.weight =
        options.train.loss.prior_normal.weight = 1;
    const DeviceChoice cpu = choose_device("cpu");
    make_stereo_priors(cpu, options.stereo, needs_of(options.train.loss).view_maps, {}, views);
    for (const View& view : views) {
        const auto &depth = values(view, "depth"), &confidence = values(view, "confidence");
        int measured = 0, near = 0, planar = 0, on_plane = 0, filled = 0, about = 0;
        for (int at = 0; at < kWidth * kHeight; ++at) {
            const auto i = static_cast<std::size_t>(at);
            const double truth =
                test::trace(view.camera, at % kWidth + 0.5, at / kWidth + 0.5).depth;
            const double error = std::abs(double(depth[i]) - truth) / truth;
            ASSERT_GT(depth[i], 0);
            const float planes = kPlanarConfidence;
            if (confidence[i] > planes)
                ++measured, near += error < 0.01;
            else if (confidence[i] == planes)
                ++planar, on_plane += error < 0.1;
            else
                ++filled, about += error < 0.1;
        }
        EXPECT_GT(measured, 0.6 * kWidth * kHeight);
        EXPECT_GT(near, 0.95 * measured);
        EXPECT_GT(planar, 100);
        EXPECT_GT(on_plane, 0.7 * planar);
        // Depths that a single view fills beyond its measurements are guesses.
        EXPECT_GT(filled, 100);
        EXPECT_GT(about, 0.45 * filled);
    }
    // Views that have all required maps stay unchanged.
    const auto before = values(views[0], "depth");
    views[0].photo = ImageU8(1, 1, 3);  // too small for stereo
    make_stereo_priors(cpu, options.stereo, needs_of(options.train.loss).view_maps, {}, views);
    EXPECT_EQ(values(views[0], "depth"), before);
}

TEST(StereoPriors, BlankPhotographsAreAnError) {
    std::vector<View> views = test::arc_views(
        3, [](const test::Surface&) { return 0.5; }, 64, 48);
    RunOptions options;
    options.train.loss.prior_depth.weight = 1;
    try {
        make_stereo_priors(choose_device("cpu"), options.stereo,
                           needs_of(options.train.loss).view_maps, {}, views);
        FAIL();
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input);
        EXPECT_NE(std::string(error.what()).find("weights of these losses"), std::string::npos);
    }
}

}  // namespace
}  // namespace tvsgs
