// Detection of a sky where views from different places see the same in one direction, its map, and
// its storage in runs.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <functional>

#include "core/error.h"
#include "core/math/rng.h"
#include "core/scene/sky_map.h"
#include "io/images/image_file.h"
#include "optim/views/matchable.h"
#include "pipeline/run/splat_selection.h"
#include "pipeline/scene/sky.h"
#include "plan/decide.h"
#include "support/numeric.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using Texture = std::function<Vec3d(Vec3d)>;

/// Random colours at integer places, linear between them.
Vec3d of_noise(Vec3d p) {
    Vec3d color;
    for (int corner = 0; corner < 8; ++corner) {
        double weight = 1;
        std::uint64_t cell = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const double low = std::floor(p[axis]), up = corner >> axis & 1;
            weight *= up > 0 ? p[axis] - low : 1 - (p[axis] - low);
            cell = cell * 10007 + static_cast<std::uint64_t>(low + up + 5000);
        }
        const Random4 r = random4(cell, RandomStream::background, 1);
        for (int c = 0; c < 3; ++c) color[c] += weight * r.v[c] / 4294967295.0;
    }
    return color;
}
Vec3d of_clouds(Vec3d direction) {
    return of_noise(25 / norm(direction) * direction);
}
Vec3d of_one_colour(Vec3d) {
    return {0.4, 0.6, 0.9};
}

/// A wall of 2 x 2 that faces -z, and its background.
struct Case {
    Texture sky = of_clouds;  // by direction
    double backdrop = 0;      // z of an infinite wall instead of the sky; 0: none
    double arc_deg = 50;      // cameras in a row look at the wall
    bool at_one_place = false;
    int views = 5;
};

constexpr int kWidth = 160, kHeight = 120;

Camera camera_at(const Case& c, int view) {
    const double angle = (static_cast<double>(view) / (c.views - 1) - 0.5) * c.arc_deg * M_PI / 180;
    const auto sine = static_cast<float>(std::sin(angle)),
               cosine = static_cast<float>(std::cos(angle));
    Camera camera{kWidth, kHeight, 130, 130, kWidth / 2.0f, kHeight / 2.0f, {}};
    camera.camera_from_world.R = {{{cosine, 0, -sine}, {0, 1, 0}, {sine, 0, cosine}}};
    const Vec3f centre = c.at_one_place ? Vec3f{0, 0, -4} : Vec3f{-4 * sine, 0, -4 * cosine};
    camera.camera_from_world.t = -(camera.camera_from_world.R * centre);
    return camera;
}

bool is_on_wall(const Camera& camera, Vec3d direction, Vec3d& place) {
    const Vec3d centre = vec_cast<double>(camera_centre(camera));
    place = centre + (-centre.z / direction.z) * direction;
    return std::abs(place.x) < 1 && std::abs(place.y) < 1;
}

Scene scene_of(const Case& c) {
    Scene scene;
    for (int v = 0; v < c.views; ++v) {
        View view;
        view.name = str(v, ".png");
        view.camera = camera_at(c, v);
        view.photo = ImageU8(kWidth, kHeight, 3);
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x) {
                const Vec3d d = vec_cast<double>(world_direction(view.camera, x, y));
                const Vec3d centre = vec_cast<double>(camera_centre(view.camera));
                Vec3d place;
                const Vec3d color =
                    is_on_wall(view.camera, d, place) ? of_noise(8.0 * place)
                    : c.backdrop != 0 ? of_noise(2.5 * (centre + (c.backdrop - centre.z) / d.z * d))
                                      : c.sky(d);
                for (int k = 0; k < 3; ++k)
                    view.photo.at(x, y, k) =
                        static_cast<std::uint8_t>(std::clamp(255 * color[k] + 0.5, 0.0, 255.0));
            }
        scene.train.push_back(std::move(view));
    }
    for (int i = 0; i < 40 * 40; ++i) {
        const float x = static_cast<float>(i % 40) / 20 - 0.975f,
                    y = static_cast<float>(i / 40) / 20 - 0.975f;
        scene.points.positions.push_back({x, y, 0});
        if (c.backdrop != 0)
            scene.points.positions.push_back({4 * x, 4 * y, static_cast<float>(c.backdrop)});
    }
    return scene;
}

SkyDetection look_at(const Scene& scene) {
    return detect_sky(scene.train, scene.points.positions);
}

/// Share of far pixels on the wall (or off it), at least `margin` from its outline.
double far_share(const Scene& scene, const SkyDetection& look, bool on_wall, int margin) {
    int all = 0, far = 0;
    for (std::size_t v = 0; v < scene.train.size(); ++v)
        for (int y = margin; y < kHeight - margin; ++y)
            for (int x = margin; x < kWidth - margin; ++x) {
                bool alike = true;
                Vec3d place;
                for (int j = -margin; j <= margin; j += margin)
                    for (int i = -margin; i <= margin; i += margin)
                        alike = alike && is_on_wall(scene.train[v].camera,
                                                    vec_cast<double>(world_direction(
                                                        scene.train[v].camera, x + i, y + j)),
                                                    place) == on_wall;
                if (alike) ++all, far += look.views[v].is_far(x, y);
            }
    EXPECT_GT(all, 1000);
    return static_cast<double>(far) / all;
}

TEST(SkyMap, EveryDirectionHasOnePlace) {
    test::Random random(1);
    for (int i = 0; i < 1000; ++i) {
        const Vec3f d = vec_cast<float>(random.normal3());
        const Vec2f p = octahedral_place(d);
        EXPECT_LE(std::max(std::abs(p.x), std::abs(p.y)), 1);
        const Vec3f back = octahedral_direction(p);
        EXPECT_LT(norm(back / norm(back) - d / norm(d)), 1e-5f);
    }
}

TEST(SkyMap, HasNoSeams) {
    constexpr int kSize = 64;
    std::vector<std::uint8_t> texels;
    for (int i = 0; i < kSize * kSize; ++i) {
        const Vec3f d =
            octahedral_direction({(static_cast<float>(i % kSize) + 0.5f) / (kSize / 2) - 1,
                                  (static_cast<float>(i / kSize) + 0.5f) / (kSize / 2) - 1});
        for (int c = 0; c < 3; ++c)
            texels.push_back(static_cast<std::uint8_t>(127.5f + 127 * d[c] / norm(d)));
    }
    const SkyMap map{texels.data(), kSize};
    test::Random random(2);
    for (int i = 0; i < 5000; ++i) {
        Vec3f d = vec_cast<float>(random.normal3());
        if (i % 2) d[i / 2 % 2] *= 1e-3f, d.z = -std::abs(d.z);  // near the cut of the lower half
        d = d / norm(d);
        const Vec3f color = map.at(d);
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(color[c], 0.5f + 0.498f * d[c], 0.03f) << i;
    }
}

TEST(LookForSky, FindsItBehindAWall) {
    const Scene scene = scene_of({});
    const SkyDetection look = look_at(scene);
    EXPECT_GT(look.share, 0.3);
    EXPECT_GT(far_share(scene, look, false, 6), 0.65);
    EXPECT_LT(far_share(scene, look, true, 6), 0.001);
}

TEST(LookForSky, NotInABackdropNorInOneColour) {
    Case backdrop, one_colour;
    backdrop.backdrop = 6, one_colour.sky = of_one_colour;
    for (const Case& c : {backdrop, one_colour}) {
        const SkyDetection look = look_at(scene_of(c));
        EXPECT_LT(look.share, 0.01);
        EXPECT_TRUE(decide_sky(look.share).settings.empty());
    }
}

/// Without camera motion the wall cannot be distinguished from a far one.
TEST(LookForSky, ViewsOfOnePlaceSayNothing) {
    Case c;
    c.at_one_place = true, c.arc_deg = 20;
    EXPECT_TRUE(std::isnan(look_at(scene_of(c)).share));
    c.at_one_place = false, c.arc_deg = 0.5;
    EXPECT_TRUE(std::isnan(look_at(scene_of(c)).share));
}

TEST(LookForSky, OnlyInsideOfMasks) {
    Scene scene = scene_of({});
    for (View& view : scene.train) {
        view.mask = ImageU8(kWidth, kHeight, 1);
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x) {
                Vec3d place;
                if (is_on_wall(view.camera, vec_cast<double>(world_direction(view.camera, x, y)),
                               place))
                    view.mask.at(x, y) = 255;
            }
    }
    const auto share = [&](bool masks) {
        return detect_sky(scene.train, scene.points.positions, masks).share;
    };
    EXPECT_LT(share(true), 0.01);
    EXPECT_GT(share(false), 0.3);
    for (View& view : scene.train)
        for (std::uint8_t& value : view.mask.pixels) value = value == 0 ? kNoPhoto : value;
    EXPECT_LT(share(false), 0.01) << "what the lens did not see";
}

TEST(PointsBeforeSky, AreThoseOfTheWall) {
    Scene scene = scene_of({});
    const std::size_t wall = scene.points.positions.size();
    const SkyDetection look = look_at(scene);
    for (const float x : {-1.7f, 1.6f})
        for (const float y : {-1.0f, 0.0f, 1.0f}) scene.points.positions.push_back({x, y, 0.3f});
    scene.points.positions.push_back({0, 0, -9});  // visible in no view
    const std::vector<std::size_t> kept =
        points_outside_sky(scene.train, look, scene.points.positions);
    ASSERT_EQ(kept.size(), wall + 1);
    EXPECT_EQ(kept[wall - 1], wall - 1);
}

TEST(MakeSky, HasItsColours) {
    const Scene scene = scene_of({});
    const SkyDetection look = look_at(scene);
    const ImageU8 sky = make_sky(scene.train, look);
    ASSERT_EQ(sky.width, 512) << "a texel per pixel: 130 sqrt(4 pi) = 461";
    ASSERT_EQ(sky.height, 512);
    const SkyMap map{sky.pixels.data(), sky.width};
    double off = 0;
    int count = 0;
    for (std::size_t v = 0; v < scene.train.size(); ++v)
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x) {
                if (!look.views[v].is_far(x, y)) continue;
                const Vec3f d = world_direction(scene.train[v].camera, x, y);
                const Vec3d truth = of_clouds(vec_cast<double>(d));
                for (int c = 0; c < 3; ++c)
                    off += std::abs(double{map.at(d)[c]} - truth[c]), ++count;
            }
    EXPECT_LT(off / count, 0.01);
    // Unseen directions resemble seen ones, and are not black.
    for (const Vec3f d : {Vec3f{0, 0, -1}, Vec3f{0, 1, 0}, Vec3f{0.1f, -1, -0.2f}})
        EXPECT_GT(map.at(d).x + map.at(d).y + map.at(d).z, 0.6f);
}

/// Filled texels are as smooth across the edges of the map as elsewhere.
TEST(MakeSky, FillsAcrossItsEdges) {
    const Scene scene = scene_of({});
    const ImageU8 sky = make_sky(scene.train, look_at(scene));
    const auto jump = [&](int x, int y, int u, int v) {
        int most = 0;
        for (int c = 0; c < 3; ++c)
            most = std::max(most, std::abs(sky.at(x, y, c) - sky.at(u, v, c)));
        return most;
    };
    const int last = sky.width - 1;
    for (int i = 0; i <= last; ++i) {
        EXPECT_LE(jump(i, 0, last - i, 0), 6) << i;
        EXPECT_LE(jump(0, i, 0, last - i), 6) << i;
        EXPECT_LE(jump(last, i, last, last - i), 6) << i;
    }
}

struct Planned {
    Configuration config;
    Scene scene;
    SkyDetection look;

    explicit Planned(const Settings& given, const Case& c = {}) : scene(scene_of(c)) {
        for (const auto& [key, value] : given) config.table.set(key, value, "the user");
        RunPlan plan;
        look = provide_sky(config, scene, &plan);
    }
    const PhotometricOptions& photometric() const { return config.options.train.loss.photometric; }
};

TEST(SoftBackground, IsTheBlurredPhotographs) {
    Scene scene = scene_of({of_one_colour});
    for (View& view : scene.train)  // a gradient by direction; black where the lens sees nothing
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x) {
                const Vec3f d = normalize(world_direction(view.camera, x, y));
                for (int c = 0; c < 3; ++c)
                    view.photo.at(x, y, c) = std::uint8_t(x < 8 ? 0 : 120 + 100 * d[c]);
            }
    for (View& view : scene.train) {
        view.mask = ImageU8(kWidth, kHeight, 1);
        for (int i = 0; i < kWidth * kHeight; ++i)
            view.mask.pixels[std::size_t(i)] = i % kWidth < 8 ? kNoPhoto : 255;
    }
    const ImageU8 map = make_soft_background(scene.train);
    const SkyMap soft{map.pixels.data(), map.width};
    const auto color_off = [&](Vec3f d, Vec3f of) {
        float most = 0;
        for (int c = 0; c < 3; ++c)
            most = std::max(most, std::abs(255 * soft.at(d)[c] - (120 + 100 * of[c])));
        return most;
    };
    EXPECT_LT(color_off({0, 0, 1}, {0, 0, 1}), 6) << "in the middle of the photographs";
    EXPECT_LT(color_off(normalize(Vec3f{0.2f, 0.1f, 1}), normalize(Vec3f{0.2f, 0.1f, 1})), 6);
    // Above: as the upper border of the photographs, blurred.
    EXPECT_LT(color_off({0, -1, 0}, normalize(Vec3f{0, -60 / 130.0f, 1})), 35);
    for (View& view : scene.train) view.mask.pixels.assign(view.mask.pixels.size(), kNoPhoto);
    EXPECT_EQ(make_soft_background(scene.train).at(5, 5, 0), 0) << "no pixel counts";
}

TEST(SoftBackground, StaysWithTheRunAndNeedsNoSky) {
    Planned p(Settings{{"loss.photometric.background", kSoftBackground}});
    EXPECT_TRUE(p.look.views.empty()) << "no search for a sky";
    PhotometricOptions options = p.photometric();
    provide_soft_background(options, p.scene.train);
    ASSERT_TRUE(options.sky);
    const std::string run = testing::TempDir() + "tvsgs_soft_background";
    std::filesystem::create_directories(run);
    write_sky(run, options);
    PhotometricOptions block;
    block.background = kSoftBackground, block.sky_from = run;
    provide_soft_background(block, {});
    EXPECT_EQ(block.sky->pixels, options.sky->pixels);
    std::filesystem::remove_all(run);
}

TEST(LookAt, ASkyIsNothingThatCouldBeMatched) {
    const Scene scene = scene_of({});
    const SceneLook bare = look_at(scene, {}), seen = look_at(scene, {}, false, look_at(scene));
    EXPECT_LT(seen.matchable, 0.7 * bare.matchable);
    EXPECT_GT(seen.points_per_pixel, 1.4 * bare.points_per_pixel);
}

TEST(ProvideSky, WhereOneIsSeen) {
    const Planned p(Settings{});
    EXPECT_EQ(p.photometric().background, "sky");
    EXPECT_EQ(p.look.views.size(), 5u);
    ASSERT_TRUE(p.photometric().sky);
}

TEST(ProvideSky, TheUserAndMasksHaveTheLastWord) {
    for (const auto& [key, value] : {std::pair{"loss.photometric.background", "none"},
                                     std::pair{"loss.photometric.background", "white"},
                                     std::pair{"loss.photometric.masks", "object"}}) {
        const Planned p(Settings{{key, value}});
        EXPECT_NE(p.photometric().background, "sky") << value;
        EXPECT_FALSE(p.photometric().sky) << value;
        EXPECT_TRUE(p.look.views.empty()) << value;
    }
    Case backdrop;
    backdrop.backdrop = 6;
    EXPECT_FALSE(Planned(Settings{}, backdrop).photometric().sky);
    EXPECT_TRUE(
        Planned(Settings{{"loss.photometric.background", "sky"}}, backdrop).photometric().sky);
}

class SkyFile : public testing::Test {
protected:
    void SetUp() override { std::filesystem::create_directories(run_); }
    void TearDown() override { std::filesystem::remove_all(run_); }

    std::string fault() {
        try {
            read_sky(options_, run_);
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input);
            return error.what();
        }
        return "";
    }

    const std::string run_ = testing::TempDir() + "tvsgs_sky_file";
    PhotometricOptions options_;
};

TEST_F(SkyFile, ComesBackAsItWas) {
    ImageU8 sky(8, 8, 3);
    for (std::size_t i = 0; i < sky.pixels.size(); ++i)
        sky.pixels[i] = static_cast<std::uint8_t>(i);
    write_sky(run_, options_);
    EXPECT_FALSE(has_sky_file(run_));
    options_.sky = std::make_shared<const ImageU8>(sky), options_.background = "sky";
    write_sky(run_, options_);
    options_.sky = nullptr;
    EXPECT_EQ(fault(), "");
    ASSERT_TRUE(options_.sky);
    EXPECT_TRUE(std::equal(sky.pixels.begin(), sky.pixels.end(), options_.sky->pixels.begin()));
    const Planned other(
        Settings{{"loss.photometric.background", "sky"}, {"loss.photometric.sky_from", run_}});
    EXPECT_EQ(other.photometric().sky->width, 8);
    options_.background = "none";
    EXPECT_EQ(fault(), "");
    EXPECT_FALSE(options_.sky);
}

TEST_F(SkyFile, IsMissedOrRefused) {
    options_.background = "sky";
    EXPECT_NE(fault().find("no sky.png"), std::string::npos);
    write_png(run_ + "/sky.png", ImageU8(8, 4, 3));
    EXPECT_NE(fault().find("8x4"), std::string::npos);
}

/// Only the sky is visible.
TEST(CompareRenders, BeforeTheSkyOfTheRun) {
    const Scene scene = scene_of({});
    Gaussians<Cpu> behind;
    resize(behind, 1, 0);
    behind.means.data()[0] = {0, 0, -20}, behind.quats.data()[0] = {1, 0, 0, 0};
    View view = scene.train[2];
    TrainOptions options;
    options.loss.photometric.background = "sky";
    EXPECT_THROW(compare_renders<Cpu>(behind, behind, {view}, options), Error);
    const auto sky = std::make_shared<const ImageU8>(make_sky(scene.train, look_at(scene)));
    options.loss.photometric.sky = sky;
    for (int i = 0; i < kWidth * kHeight; ++i) {
        const Vec3f color = SkyMap{sky->pixels.data(), sky->width}.at(
            world_direction(view.camera, i % kWidth, i / kWidth));
        for (int c = 0; c < 3; ++c)
            view.photo.at(i % kWidth, i / kWidth, c) =
                static_cast<std::uint8_t>(245 * color[c] + 5);
    }
    const double psnr = compare_renders<Cpu>(behind, behind, {view}, options).before;
    EXPECT_GT(psnr, 35);
    EXPECT_LT(psnr, 50);
}

}  // namespace
}  // namespace tvsgs
