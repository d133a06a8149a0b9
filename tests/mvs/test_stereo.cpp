// Tests depth, normals and the cloud on scenes with known surfaces.

#include <algorithm>

#include "analytic_scene.h"
#include "core/device/threads.h"
#include "core/error.h"
#include "mvs/stereo/patch_match.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

double textured(const test::Surface& surface) {
    return test::texture(surface.point);
}

struct Quality {
    int pixels = 0, found = 0, near = 0, aligned = 0;  // of the central view
};

Quality judge(const View& view, const StereoMaps& map) {
    Quality q;
    for (int y = 0; y < map.camera.height_px; ++y)
        for (int x = 0; x < map.camera.width_px; ++x) {
            const test::Surface truth = test::trace(view.camera, x + 0.5, y + 0.5);
            const std::size_t at =
                std::size_t(y) * std::size_t(map.camera.width_px) + std::size_t(x);
            ++q.pixels;
            if (!(map.depth[at] > 0)) continue;
            ++q.found;
            q.near += std::abs(double(map.depth[at]) - truth.depth) < 0.01 * truth.depth;
            const Vec3d normal = mat_cast<double>(view.camera.camera_from_world.R) * truth.normal;
            q.aligned +=
                dot(vec_cast<double>(map.normals[at]), normal) > std::cos(15 * 3.14159 / 180);
        }
    return q;
}

template <class Device>
StereoResult run(const std::vector<View>& views, const StereoOptions& o = {}) {
    return reconstruct_stereo(Device{}, views, {}, o);
}

// 19 of 20 depths are within 1 % of the truth, and 9 of 10 normals within 15 degrees.
TEST(Stereo, FindsBallAndWall) {
    const std::vector<View> views = test::arc_views(3, textured, 160, 120);
    const StereoResult result = run<Cpu>(views);
    ASSERT_EQ(result.maps.size(), 3u);
    for (std::size_t v = 0; v < 3; ++v) {
        const Quality q = judge(views[v], result.maps[v]);
        EXPECT_GT(q.found, (v == 1 ? 0.8 : 0.6) * q.pixels) << "the outer views show more alone";
        EXPECT_GT(q.near, 0.95 * q.found);
        EXPECT_GT(q.aligned, 0.9 * q.found);
    }

    // Points lie on the surfaces, look like them, and appear once.
    const PointCloud& cloud = result.cloud;
    ASSERT_GT(cloud.positions.size(), 6000u);
    EXPECT_LT(cloud.positions.size(), 2 * 160 * 120u) << "three views of one surface";
    ASSERT_EQ(cloud.normals.size(), cloud.positions.size());
    ASSERT_EQ(cloud.colors.size(), cloud.positions.size());
    ASSERT_EQ(cloud.confidences.size(), cloud.positions.size());
    std::size_t on_surface = 0, facing = 0, coloured = 0;
    for (std::size_t i = 0; i < cloud.positions.size(); ++i) {
        const Vec3d p = vec_cast<double>(cloud.positions[i]);
        const double ball = std::abs(norm(p) - test::kBallRadius);
        const double wall = std::abs(dot(test::kWallNormal, p) - test::kWallOffset);
        const Vec3d normal = ball < wall ? normalize(p) : test::kWallNormal;
        on_surface += std::min(ball, wall) < 0.03;
        facing += dot(normal, vec_cast<double>(cloud.normals[i])) > 0.9;
        coloured += std::abs(double(cloud.colors[i].x) - test::texture(p)) < 0.15;
        EXPECT_TRUE(cloud.confidences[i] > 0 && cloud.confidences[i] <= 1);
    }
    const double n = double(cloud.positions.size());
    EXPECT_GT(double(on_surface), 0.97 * n);
    EXPECT_GT(double(facing), 0.9 * n);
    EXPECT_GT(double(coloured), 0.9 * n);
}

TEST(Stereo, TwoViewsAreEnough) {
    const std::vector<View> views = test::arc_views(2, textured);
    const StereoResult result = run<Cpu>(views);
    const Quality q = judge(views[0], result.maps[0]);
    EXPECT_GT(q.found, 0.5 * q.pixels);
    EXPECT_GT(q.near, 0.95 * q.found);
}

TEST(Stereo, ManyViewsConfirmTwice) {
    const std::vector<View> views = test::arc_views(6, textured, 96, 72, 0.12);
    const StereoResult result = run<Cpu>(views);
    const Quality q = judge(views[3], result.maps[3]);
    EXPECT_GT(q.found, 0.6 * q.pixels);
    EXPECT_GT(q.near, 0.95 * q.found);
}

TEST(Stereo, OneConfirmsWhereFewCanSee) {
    const std::vector<View> views = test::arc_views(6, textured, 96, 72, 0.15);
    StereoOptions twice;
    twice.min_consistent = 2;
    const auto outer = [&](const StereoOptions& o) {
        return judge(views[0], run<Cpu>(views, o).maps[0]);
    };
    const Quality one = outer({}), two = outer(twice);
    EXPECT_GT(one.found, 1.1 * two.found);
    // One source less lowers the share by less than a hundredth: 0.963 against 0.967.
    EXPECT_GT(double(one.near) / one.found, double(two.near) / two.found - 0.01);
}

TEST(Stereo, PlainSurfacesGetNoPoints) {
    const std::vector<View> views = test::arc_views(
        3, [](const test::Surface& s) { return s.is_ball ? 0.6 : test::texture(s.point); });
    const StereoResult result = run<Cpu>(views);
    int inside = 0, found = 0;
    const StereoMaps& map = result.maps[1];
    for (int y = 0; y < map.camera.height_px; ++y)
        for (int x = 0; x < map.camera.width_px; ++x) {
            // Patches at the edge of the ball see its outline, which is texture.
            bool plain = true;
            for (int corner = 0; corner < 4; ++corner)
                plain &= test::trace(views[1].camera, x + 0.5 + ((corner & 1) != 0 ? 8 : -8),
                                     y + 0.5 + ((corner & 2) != 0 ? 8 : -8))
                             .is_ball;
            inside += plain;
            found += plain && map.depth[std::size_t(y * map.camera.width_px + x)] > 0;
        }
    EXPECT_GT(inside, 300);
    EXPECT_EQ(found, 0);
    EXPECT_GT(result.cloud.positions.size(), 2000u) << "the wall is still there";
}

/// Grey noise of a camera, equal in every run.
void add_noise(std::vector<View>& views, double deviation) {
    test::Random random(11);
    for (View& view : views)
        for (std::uint8_t& p : view.photo.pixels)
            p = std::uint8_t(std::clamp(p + 255 * deviation * random.normal(), 0.0, 255.0));
}

/// For one view: its pixels on the ball or on the wall, with a depth, and within 1 %.
template <class Chosen>
Quality judge_part(const View& view, const StereoMaps& map, const Chosen& chosen) {
    Quality q;
    for (int y = 0; y < map.camera.height_px; ++y)
        for (int x = 0; x < map.camera.width_px; ++x) {
            const test::Surface truth = test::trace(view.camera, x + 0.5, y + 0.5);
            if (!chosen(truth)) continue;
            const float depth = map.depth[std::size_t(y * map.camera.width_px + x)];
            ++q.pixels;
            q.found += depth > 0;
            q.near += depth > 0 && std::abs(double(depth) - truth.depth) < 0.01 * truth.depth;
        }
    return q;
}
bool on_ball(const test::Surface& s) {
    return s.is_ball;
}

// Noise on a plain ball in front of a textured wall: nothing determines its depth.
TEST(Stereo, NoiseOnAPlainObjectGivesNoDepth) {
    std::vector<View> views = test::arc_views(
        3, [](const test::Surface& s) { return s.is_ball ? 0.6 : test::texture(s.point); });
    add_noise(views, 0.01);
    // 9 px inside the outline, where no patch sees the wall.
    const Quality ball = judge_part(views[1], run<Cpu>(views).maps[1], [](const test::Surface& s) {
        return s.is_ball && s.normal.z < -0.6;
    });
    ASSERT_GT(ball.pixels, 3000);
    EXPECT_LT(ball.found, 0.02 * ball.pixels) << "more than chance";
}

// A wall whose waves repeat every 10 px: other parts of it match equally well in every view.
TEST(Stereo, RepeatedTextureGivesNoPoints) {
    const std::vector<View> views = test::arc_views(3, [](const test::Surface& s) {
        if (s.is_ball) return test::texture(s.point);
        const double wave = 2 * 3.14159265 / 0.23;
        return 0.5 + 0.2 * std::sin(wave * s.point.x) + 0.2 * std::sin(wave * s.point.y);
    });
    const auto on_wall = [](const test::Surface& s) { return !s.is_ball; };
    const StereoMaps map = run<Cpu>(views).maps[1];
    const Quality wall = judge_part(views[1], map, on_wall),
                  ball = judge_part(views[1], map, on_ball);
    // Patches that reach the ball, or the ends of the range, are unique: 15.5 % of all.
    EXPECT_LT(wall.found, 0.2 * wall.pixels);
    EXPECT_GT(ball.near, 0.8 * ball.pixels);
}

TEST(Stereo, BlankImagesGiveNothing) {
    const std::vector<View> views = test::arc_views(
        3, [](const test::Surface&) { return 0.5; }, 64, 48);
    const StereoResult result = run<Cpu>(views);
    EXPECT_TRUE(result.cloud.positions.empty());
    for (const StereoMaps& map : result.maps)
        EXPECT_EQ(std::count(map.depth.begin(), map.depth.end(), 0.0f),
                  std::ptrdiff_t(map.depth.size()));
}

TEST(Stereo, MasksLimitIt) {
    std::vector<View> views = test::arc_views(3, textured, 64, 48);
    for (View& view : views) {
        view.mask = ImageU8(64, 48, 1, 0);
        for (int y = 0; y < 48; ++y)
            for (int x = 0; x < 32; ++x) view.mask.at(x, y) = 255;
    }
    StereoOptions o;
    o.use_masks = true;
    const StereoResult result = run<Cpu>(views, o);
    int left = 0, right = 0;
    for (int i = 0; i < 64 * 48; ++i)
        (i % 64 < 32 ? left : right) += result.maps[1].depth[std::size_t(i)] > 0;
    EXPECT_GT(left, 300);
    EXPECT_EQ(right, 0);
}

TEST(Stereo, SameBitsForAnyNumberOfThreads) {
    const std::vector<View> views = test::arc_views(3, textured, 64, 48);
    const int before = thread_count();
    set_thread_count(1);
    const StereoResult a = run<Cpu>(views);
    set_thread_count(3);
    const StereoResult b = run<Cpu>(views);
    set_thread_count(before);
    ASSERT_GT(a.cloud.positions.size(), 500u);
    ASSERT_EQ(a.cloud.positions.size(), b.cloud.positions.size());
    for (std::size_t i = 0; i < a.cloud.positions.size(); ++i)
        ASSERT_TRUE(a.cloud.positions[i].x == b.cloud.positions[i].x &&
                    a.cloud.normals[i].z == b.cloud.normals[i].z &&
                    a.cloud.confidences[i] == b.cloud.confidences[i]);
    for (std::size_t v = 0; v < 3; ++v) EXPECT_EQ(a.maps[v].depth, b.maps[v].depth);

    StereoOptions other;
    other.seed = 1;
    EXPECT_NE(run<Cpu>(views, other).maps[0].depth, a.maps[0].depth);
}

std::string refusal(const std::vector<View>& views) {
    try {
        run<Cpu>(views);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input);
        return error.what();
    }
    return "accepted";
}

TEST(Stereo, RefusesWhatCannotWork) {
    std::vector<View> views = test::arc_views(2, textured, 48, 36);
    EXPECT_NE(refusal({views[0]}).find("at least 2 views, found 1"), std::string::npos)
        << refusal({views[0]});
    views[1].camera.camera_from_world.R =
        rotation(Quatf{0, 0, 1, 0}) * views[1].camera.camera_from_world.R;  // turned around
    EXPECT_NE(refusal(views).find("overlap"), std::string::npos) << refusal(views);
    const std::vector<View> same = {test::arc_views(1, textured, 48, 36)[0],
                                    test::arc_views(1, textured, 48, 36)[0]};
    EXPECT_NE(refusal(same).find("range of depths"), std::string::npos) << refusal(same);
    EXPECT_NE(refusal(test::arc_views(2, textured, 12, 9)).find("too small for stereo"),
              std::string::npos);
}

// Rounding differs between the devices and the search is chaotic, so the test compares statistics:
// both find nearly the same pixels, with the same surface there.
TEST(StereoTwins, Agree) {
    if (const std::string reason = test::no_cuda(); !reason.empty()) GTEST_SKIP() << reason;
    if constexpr (kHasCuda) {
        const std::vector<View> views = test::arc_views(3, textured);
        const StereoResult cpu = run<Cpu>(views), cuda = run<Cuda>(views);
        for (std::size_t v = 0; v < 3; ++v) {
            int both = 0, either = 0, same = 0;
            for (std::size_t i = 0; i < cpu.maps[v].depth.size(); ++i) {
                const float a = cpu.maps[v].depth[i], b = cuda.maps[v].depth[i];
                either += a > 0 || b > 0;
                both += a > 0 && b > 0;
                same += a > 0 && b > 0 && std::abs(a - b) < 0.005f * a;
            }
            EXPECT_GT(both, 0.95 * either);
            EXPECT_GT(same, 0.97 * both);
            const Quality q = judge(views[v], cuda.maps[v]);
            EXPECT_GT(q.near, 0.95 * q.found);
            // Normals are the least stable result: the share of good normals must equal the CPU's.
            const Quality reference = judge(views[v], cpu.maps[v]);
            EXPECT_GT(double(q.aligned) / q.found,
                      double(reference.aligned) / reference.found - 0.01);
        }
        const StereoResult again = run<Cuda>(views);
        for (std::size_t v = 0; v < 3; ++v) EXPECT_EQ(again.maps[v].depth, cuda.maps[v].depth);
    }
}

}  // namespace
}  // namespace tvsgs
