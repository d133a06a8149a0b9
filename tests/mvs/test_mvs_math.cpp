// Tests the formulas of stereo for one pixel.
#include "analytic_scene.h"
#include "mvs/stereo/depth_fusion_bodies.h"
#include "mvs/stereo/mvs_math.h"
#include "mvs/stereo/stereo_images.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

TEST(PlaneWarp, FollowsPointsOfThePlane) {
    const Camera reference = test::arc_camera(200, 150, 0.1),
                 other = test::arc_camera(220, 160, 0.5);
    const SourceView source = make_source(reference, other, 1, 0);
    const int x = 93, y = 71;
    const SurfacePlane plane{normalize(Vec3f{0.3f, -0.2f, -0.9f}), 3.7f};
    const PatchWarp warp = plane_warp(source, reference, x, y, plane);
    for (const auto& [dx, dy] : {std::pair{0, 0}, {7, 0}, {0, -7}, {-5, 3}}) {
        const Vec3f own = pixel_ray(reference, x, y), ray = pixel_ray(reference, x + dx, y + dy);
        const Vec3f point = depth_on_ray(plane, own, ray) * ray;
        EXPECT_NEAR(dot(plane.normal, point), plane.depth * dot(plane.normal, own), 1e-5);
        const Vec3f there = source.source_from_reference * point;
        const Vec3f h = warp.at_centre + float(dx) * warp.per_x + float(dy) * warp.per_y;
        // Floats of a few hundred pixels: a thousandth of a pixel is ample.
        EXPECT_NEAR(h.x / h.z, other.fx_px * there.x / there.z + other.cx_px, 1e-3);
        EXPECT_NEAR(h.y / h.z, other.fy_px * there.y / there.z + other.cy_px, 1e-3);
    }
}

TEST(PlaneWarp, MovesAlongTheEpipolarLine) {
    const Camera reference = test::arc_camera(200, 150, 0.1),
                 other = test::arc_camera(220, 160, 0.5);
    const SourceView source = make_source(reference, other, 1, 0);
    const SurfacePlane plane{normalize(Vec3f{0.3f, -0.2f, -0.9f}), 3.7f};
    const PatchWarp warp = plane_warp(source, reference, 93, 71, plane);
    const float step = 4 / pixels_per_step(warp, source);
    const PatchWarp there = moved(warp, source, step);
    const Vec3f p = source.source_from_reference *
                    ((1 / (1 / plane.depth + step)) * pixel_ray(reference, 93, 71));
    const Vec3f from = warp.at_centre / warp.at_centre.z, to = there.at_centre / there.at_centre.z;
    EXPECT_NEAR(to.x, other.fx_px * p.x / p.z + other.cx_px, 1e-3);  // as above
    EXPECT_NEAR(to.y, other.fy_px * p.y / p.z + other.cy_px, 1e-3);
    EXPECT_NEAR(norm(to - from), 4, 0.2) << "the speed changes a little on the way";
}

class PatchCost : public testing::Test {
protected:
    static constexpr int kWidth = 40, kHeight = 30;
    static float pattern(int x, int y) { return float(test::texture({0.05 * x, 0.05 * y, 0.3})); }
    template <class F>
    static std::vector<float> image(const F& f) {
        std::vector<float> pixels;
        for (int y = 0; y < kHeight; ++y)
            for (int x = 0; x < kWidth; ++x) pixels.push_back(float(f(x, y)));
        return pixels;
    }
    /// The source shows the same pixels, moved by `shift`.
    static float cost(const std::vector<float>& reference,
                      const std::vector<float>& source,
                      float shift = 0,
                      int side = 6) {
        ReferencePatch patch;
        make_patch({reference.data(), kWidth, kHeight}, 18, 14, side, patch);
        return patch_cost(patch, {source.data(), kWidth, kHeight},
                          {{18.5f + shift, 14.5f, 1}, {1, 0, 0}, {0, 1, 0}});
    }
};

TEST_F(PatchCost, KnowsLikenessWhateverTheExposure) {
    const std::vector<float> same = image(pattern);
    for (const int side : {4, 6, 8}) EXPECT_NEAR(cost(same, same, 0, side), 0, 1e-5);
    EXPECT_NEAR(cost(same, image([](int x, int y) { return 0.1 + 0.6 * pattern(x, y); })), 0, 1e-4);
    EXPECT_NEAR(cost(same, image([](int x, int y) { return 1 - pattern(x, y); })), 2, 1e-4);
    EXPECT_GT(cost(same, same, 3), 0.2) << "moved by three pixels";
    const float half = cost(same, same, 0.5f);
    EXPECT_TRUE(half > 0 && half < cost(same, same, 1)) << half;
}

TEST_F(PatchCost, RefusesWhatCannotBeCompared) {
    const std::vector<float> same = image(pattern);
    const std::vector<float> flat = image([](int, int) { return 0.4; });
    EXPECT_EQ(cost(flat, same), kWorstCost);
    EXPECT_EQ(cost(same, flat), kWorstCost);
    EXPECT_EQ(cost(same, same, 100), kWorstCost) << "outside";
    EXPECT_EQ(cost(same, same, std::nanf("")), kWorstCost);
    ReferencePatch patch;
    make_patch({same.data(), kWidth, kHeight}, 18, 14, 6, patch);
    EXPECT_EQ(
        patch_cost(patch, {same.data(), kWidth, kHeight}, {{-18, -14, -1}, {1, 0, 0}, {0, 1, 0}}),
        kWorstCost)
        << "behind the camera";
}

TEST_F(PatchCost, WorksAtTheBorder) {
    const std::vector<float> same = image(pattern);
    ReferencePatch patch;
    for (const auto& [x, y] : {std::pair{0, 0}, {kWidth - 1, kHeight - 1}, {1, kHeight - 1}}) {
        make_patch({same.data(), kWidth, kHeight}, x, y, 8, patch);
        EXPECT_NEAR(patch_cost(patch, {same.data(), kWidth, kHeight},
                               {{float(x) + 0.5f, float(y) + 0.5f, 1}, {1, 0, 0}, {0, 1, 0}}),
                    0, 1e-4);
    }
}

TEST(Crosscheck, AgreesWithTheSurface) {
    const Camera reference = test::arc_camera(120, 90, 0), other = test::arc_camera(120, 90, 0.3);
    const SourceView source = make_source(reference, other, 1, 0);
    std::vector<float> depths;
    for (int y = 0; y < 90; ++y)
        for (int x = 0; x < 120; ++x)
            depths.push_back(float(test::trace(other, x + 0.5, y + 0.5).depth));
    const Span<const float> span{depths.data(), depths.size()};
    int checked = 0;
    for (int y = 5; y < 85; y += 7)
        for (int x = 40; x < 80; x += 7) {
            const float depth = float(test::trace(reference, x + 0.5, y + 0.5).depth);
            const Vec3f ray = pixel_ray(reference, x, y);
            const Crosscheck check = crosscheck(source, reference, depth * ray, span);
            if (check.pixel < 0 || !(std::abs(check.point_reference.z - depth) < 0.05f)) continue;
            ++checked;
            EXPECT_LT(check.reprojection_px, 1.5) << "half a source pixel, on a slant";
            const Crosscheck off = crosscheck(source, reference, 0.85f * depth * ray, span);
            if (off.pixel >= 0) {
                EXPECT_GT(off.reprojection_px, 2) << x << " " << y;
            }
        }
    EXPECT_GT(checked, 20);
}

TEST(AgreementNeeded, TwoWhereMoreThanFourCanSee) {
    const Camera reference = test::arc_camera(120, 90, 0);
    const test::Surface seen = test::trace(reference, 60.5, 45.5);
    const Vec3f point = float(seen.depth) * pixel_ray(reference, 60, 45);
    const Vec3f normal = reference.camera_from_world.R * vec_cast<float>(seen.normal);
    std::vector<SourceView> sources;
    std::vector<float> depths(120 * 90, float(seen.depth));
    const auto add = [&](const Camera& camera, float depth) {
        sources.push_back(make_source(reference, camera, 1, int(depths.size())));
        depths.insert(depths.end(), 120 * 90, depth);
    };
    const auto needed = [&](int fixed) {
        StereoPass pass;
        pass.sources = {sources.data(), sources.size()};
        return agreement_needed({2, 0.01f, 0.9f, fixed}, pass, point, normal,
                                {depths.data(), depths.size()});
    };
    for (const float angle : {-0.2f, -0.1f, 0.1f, 0.2f})
        add(test::arc_camera(120, 90, angle), angle < 0 ? 0 : float(seen.depth));
    EXPECT_EQ(needed(0), 1);
    EXPECT_EQ(needed(3), 3);
    add(test::arc_camera(120, 90, 3), 0);
    EXPECT_EQ(needed(0), 1) << "from behind, nothing is seen of it";
    Camera away = test::arc_camera(120, 90, 0.1);
    away.cx_px += 500;
    add(away, 0);
    EXPECT_EQ(needed(0), 1) << "outside of the photograph";
    add(test::arc_camera(120, 90, 0.15), 0.8f * float(seen.depth));
    EXPECT_EQ(needed(0), 1) << "hidden behind something nearer";
    add(test::arc_camera(120, 90, 0.15), 1.2f * float(seen.depth));
    EXPECT_EQ(needed(0), 2) << "it sees through the point";
    EXPECT_EQ(needed(1), 1);
}

TEST(Checkerboard, VisitsEveryPixelOnce) {
    for (const auto& [width, height] : {std::pair{1, 1}, {33, 17}, {64, 32}, {31, 50}}) {
        std::vector<int> visits(std::size_t(width * height), 0);
        for (int color = 0; color < 2; ++color)
            for (int i = 0; i < Checkerboard::count(width, height); ++i) {
                const Vec2<int> p = Checkerboard{width, height, color}.pixel(i);
                if (p.x >= width || p.y >= height) continue;
                EXPECT_EQ((p.x + p.y) & 1, color);
                ++visits[std::size_t(p.y * width + p.x)];
            }
        EXPECT_EQ(std::count(visits.begin(), visits.end(), 1), width * height);
    }
}

TEST(Facing, NormalsCanBeSeen) {
    test::Random random(3);
    for (int i = 0; i < 200; ++i) {
        const Vec3f ray{float(random.uniform(-1, 1)), float(random.uniform(-1, 1)), 1};
        const Vec3f n = facing(normalize(vec_cast<float>(random.normal3())), ray);
        EXPECT_NEAR(norm(n), 1, 1e-5);
        EXPECT_LT(dot(n, ray), -kMinFacing);
    }
}

TEST(DropRepeated, MostAroundDecide) {
    constexpr int kWidth = 80, kHeight = 60;
    std::vector<std::uint8_t> kinds(kWidth * kHeight, kUnique);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 50; x < kWidth; ++x) kinds[std::size_t(y * kWidth + x)] = kRepeated;
    for (int i = 0; i < kWidth * kHeight; i += 5)  // one in five matches by chance, or not
        kinds[std::size_t(i)] = i % kWidth < 50 ? kRepeated : kUnique;
    kinds[30 * kWidth + 10] = kNoDepth;
    std::vector<float> depths(kinds.size(), 2.0f), confidences(kinds.size(), 0.5f);
    const DropRepeatedBody body{kWidth,
                                kHeight,
                                {kinds.data(), kinds.size()},
                                {depths.data(), depths.size()},
                                {confidences.data(), confidences.size()}};
    for (int i = 0; i < kWidth * kHeight; ++i) body(i);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const std::size_t at = std::size_t(y * kWidth + x);
            if (x < 45) {
                EXPECT_EQ(depths[at], 2) << x << " " << y;
            }
            if (x > 55) {
                EXPECT_TRUE(depths[at] == 0 && confidences[at] == 0) << x << " " << y;
            }
        }
}

TEST(DepthSegments, SmallPiecesGo) {
    constexpr int kWidth = 40, kHeight = 20;
    std::vector<float> depth(kWidth * kHeight, 2.0f), confidence(kWidth * kHeight, 1.0f);
    const auto raise = [&](int left, int columns, int rows) {  // by a step of 5 %
        for (int y = 5; y < 5 + rows; ++y)
            for (int x = left; x < left + columns; ++x) depth[std::size_t(y * kWidth + x)] = 2.1f;
    };
    raise(5, 11, 9), raise(25, 10, 10);
    depth[0] = 0;
    remove_small_segments({{kWidth, kHeight, depth.data(), confidence.data()}});
    EXPECT_EQ(depth[6 * kWidth + 6], 0);
    EXPECT_EQ(confidence[6 * kWidth + 6], 0);
    EXPECT_EQ(depth[6 * kWidth + 26], 2.1f) << "100 pixels stay";
    EXPECT_EQ(depth[1], 2);
    EXPECT_EQ(std::count(depth.begin(), depth.end(), 0.0f), 1 + 99);
}

}  // namespace
}  // namespace tvsgs
