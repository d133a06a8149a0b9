// Surface that a single view sees: which of its pixels are trusted, and what other views remove.
#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <functional>

#include "core/device/cuda_device.h"
#include "mesh/fuse/depth_clean.h"
#include "mesh/fuse/fusion.h"
#include "mesh/fuse/pixel_trust.h"

namespace tvsgs {
namespace {

/// Intersection of a ray from `eye` with the scene: distance in units of the ray, and normal.
struct Hit {
    double s;  // 0: none
    Vec3d normal;
};
using Surface = std::function<Hit(Vec3d eye, Vec3d ray)>;

/// The square |x - cx|, |y| < half at depth z, facing the cameras, which look along +z.
Surface screen(double cx, double z, double half) {
    return [=](Vec3d eye, Vec3d ray) -> Hit {
        const double s = (z - eye.z) / ray.z;
        const Vec3d p = eye + s * ray;
        const bool hit = s > 0 && std::abs(p.x - cx) < half && std::abs(p.y) < half;
        return {hit ? s : 0, {0, 0, -1}};
    };
}
Surface nearest(std::vector<Surface> all) {
    return [all](Vec3d eye, Vec3d ray) {
        Hit best{};
        for (const Surface& one : all)
            if (const Hit hit = one(eye, ray); hit.s > 0 && !(best.s > 0 && best.s <= hit.s))
                best = hit;
        return best;
    };
}

constexpr int kWidth = 120, kHeight = 60;

struct TestView {
    Vec3d eye;
    Surface surface;
    double toward = 1;  // it looks along +z, or with -1 along -z
};

Camera camera_of(const TestView& view) {
    Camera camera{kWidth, kHeight, 100, 100, 0.5f * kWidth, 0.5f * kHeight, {}};
    const double f = view.toward;
    const Mat3<double> R{{{f, 0, 0}, {0, 1, 0}, {0, 0, f}}};
    camera.camera_from_world = {mat_cast<float>(R), vec_cast<float>(-(R * view.eye))};
    return camera;
}

/// Its maps as a rasteriser would render them.
template <class Device>
void render(const TestView& view, RenderedImages<Device>& images) {
    std::vector<float> depth, transmittance;
    std::vector<Vec3f> normals;
    const Camera camera = camera_of(view);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const Vec3d ray = vec_cast<double>(pixel_ray(camera, x, y));
            const Hit hit =
                view.surface(view.eye, {view.toward * ray.x, ray.y, view.toward * ray.z});
            depth.push_back(static_cast<float>(hit.s));
            transmittance.push_back(0);
            const Vec3d n = hit.normal;
            normals.push_back(vec_cast<float>(Vec3d{view.toward * n.x, n.y, view.toward * n.z}));
        }
    copy(depth, images.depth), copy(transmittance, images.transmittance);
    copy(normals, images.normal);
    copy(std::vector<Vec3f>(depth.size(), Vec3f{0.5f, 0.5f, 0.5f}), images.color);
}

DepthRules rules_with(bool trust) {
    DepthRules rules;
    rules.depth_max = 100;
    rules.trust = trust;
    return rules;
}

constexpr float kVoxel = 0.02f;  // about a pixel at depth 2

template <class Device>
TriangleMesh fused(const std::vector<TestView>& views, bool trust, float min_weight = 1) {
    RenderedImages<Device> images;
    CleanDepth<Device> clean;
    const auto source = [&](int i) -> DepthView<Device> {
        const TestView& view = views[static_cast<std::size_t>(i)];
        render(view, images);
        const Camera camera = camera_of(view);
        clean_depth(images, camera, {}, rules_with(trust), clean);
        return {camera, std::as_const(clean.depth).span(), images.color.span(),
                std::as_const(clean.weight).span()};
    };
    TsdfOptions options{kVoxel, 4 * kVoxel, 0};
    options.trust = trust;
    FusionReport report;
    return fuse_views<Device>(static_cast<int>(views.size()), source, options, min_weight,
                              testing::TempDir() + "tvsgs_trust", report);
}

int count(const TriangleMesh& mesh, const std::function<bool(Vec3f)>& is) {
    return static_cast<int>(std::count_if(mesh.vertices.begin(), mesh.vertices.end(), is));
}

// A screen over the left half, at depth 2, in front of a wall. If the truncations of both overlap,
// a curtain of surface joins them; else it hangs from the screen.
Surface step(double wall) {
    return nearest({screen(-3, 2, 3), screen(0, wall, 20)});
}
const Surface kStep = step(2.1);
bool on_screen(Vec3f p) {
    return std::abs(p.z - 2) < 1e-3;
}
bool on_wall(Vec3f p) {
    return std::abs(p.z - 2.1) < 1e-3;
}
bool on_curtain(Vec3f p) {
    return p.z > 2 + kVoxel && p.z < 2.1f - kVoxel;
}

TEST(Trust, OneViewAloneKeepsWhatIsAwayFromTheEdge) {
    const std::vector<TestView> one{{{0, 0, 0}, kStep}};
    const TriangleMesh all = fused<Cpu>(one, false), trusted = fused<Cpu>(one, true);
    EXPECT_GT(count(all, on_curtain), 50);
    EXPECT_EQ(count(trusted, on_curtain), 0);
    // One column of 60 pixels is not trusted, on the far side of the edge.
    EXPECT_EQ(count(trusted, on_screen), count(all, on_screen));
    EXPECT_GT(count(trusted, on_wall), 0.96 * count(all, on_wall));
    EXPECT_LT(count(trusted, on_wall), count(all, on_wall));
}

TEST(Trust, TwoViewsConfirmWhatNeitherMay) {
    // Two views at one position see the same strip of the wall right at the edge.
    const std::vector<TestView> one{{{0, 0, 0}, kStep}},
        two{{{0, 0, 0}, kStep}, {{0, 0, 0}, kStep}};
    const TriangleMesh all = fused<Cpu>(one, false), confirmed = fused<Cpu>(two, true);
    EXPECT_EQ(count(confirmed, on_wall), count(all, on_wall));
    EXPECT_EQ(count(confirmed, on_screen), count(all, on_screen));
}

TEST(Trust, ThreeViewsLeaveTheCurtainsOfTwo) {
    // Each view has its own curtain along its ray past the edge; the region behind the screen that
    // two views see, up to the truncation, closes it at the side.
    const std::vector<TestView> three{
        {{-0.9, 0, 0}, step(2.4)}, {{0, 0, 0}, step(2.4)}, {{0.9, 0, 0}, step(2.4)}};
    const auto on_far_wall = [](Vec3f p) { return std::abs(p.z - 2.4) < 1e-3; };
    const TriangleMesh all = fused<Cpu>(three, false), trusted = fused<Cpu>(three, true),
                       two = fused<Cpu>(three, false, 2);
    const int alone = count(all, on_curtain) - count(two, on_curtain);
    EXPECT_GT(alone, 50);
    EXPECT_LT(count(trusted, on_curtain) - count(two, on_curtain), alone / 10);
    EXPECT_GT(count(trusted, on_screen), 0.97 * count(all, on_screen));
    EXPECT_GT(count(trusted, on_far_wall), 0.97 * count(all, on_far_wall));
    // The margins are in the image of a single view and stay.
    const auto left = [](Vec3f p) { return on_screen(p) && p.x < -1.3f; };
    const auto right = [&](Vec3f p) { return on_far_wall(p) && p.x > 1.4f; };
    EXPECT_GT(count(trusted, left), 500);
    EXPECT_EQ(count(trusted, left), count(all, left));
    EXPECT_EQ(count(two, left), 0);
    EXPECT_GT(count(trusted, right), 500);
    EXPECT_EQ(count(trusted, right), count(all, right));
}

TEST(Trust, FreeSpaceOfAnotherViewRemovesWhatHangsInIt) {
    const Surface wall = screen(0, 2, 20);
    const auto hangs = [](Vec3f p) { return std::abs(p.z - 1.2) < 0.1; };
    const TestView sees{{0, 0, 0}, nearest({screen(0, 1.2, 0.2), wall})};
    EXPECT_GT(count(fused<Cpu>({sees}, true), hangs), 200);
    EXPECT_GT(count(fused<Cpu>({sees, {{0.3, 0, 0}, wall}}, false), hangs), 200);
    EXPECT_EQ(count(fused<Cpu>({sees, {{0.3, 0, 0}, wall}}, true), hangs), 0);
    // The order of the views does not matter.
    EXPECT_EQ(count(fused<Cpu>({{{0.3, 0, 0}, wall}, sees}, true), hangs), 0);
    // A view gives no verdict where it has no depth, or where its own surface is in front.
    const Surface nothing = [](Vec3d, Vec3d) { return Hit{}; };
    EXPECT_GT(count(fused<Cpu>({sees, {{0.3, 0, 0}, nothing}}, true), hangs), 200);
    EXPECT_GT(count(fused<Cpu>({sees, {{0.3, 0, 0}, screen(0, 0.8, 20)}}, true), hangs), 200);
    // Two views against one.
    EXPECT_GT(count(fused<Cpu>({sees, sees, {{0.3, 0, 0}, wall}}, true), hangs), 200);
}

TEST(Trust, RoughPixelsTakeNothingAway) {
    // The other view sees the wall, but its depths jump from pixel to pixel.
    const auto hangs = [](Vec3f p) { return std::abs(p.z - 1.2) < 0.1; };
    const TestView sees{{0, 0, 0}, nearest({screen(0, 1.2, 0.2), screen(0, 2, 20)})};
    int calls = 0;
    const Surface rough = [&](Vec3d, Vec3d ray) -> Hit {
        return {(2 + 0.1 * (++calls % 2)) / ray.z, {0, 0, -1}};
    };
    EXPECT_GT(count(fused<Cpu>({sees, {{0.3, 0, 0}, rough}}, true), hangs), 200);
}

template <class T>
void expect_same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
    ASSERT_EQ(a.size(), b.size());
    EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(T)), 0);
}
void expect_same_bytes(const TriangleMesh& a, const TriangleMesh& b) {
    ASSERT_GT(a.faces.size(), 1000u);
    expect_same_bytes(a.vertices, b.vertices);
    expect_same_bytes(a.colors, b.colors);
    expect_same_bytes(a.faces, b.faces);
}

TEST(Trust, ViewsThatDoNotOverlapLoseNothing) {
    // Back to back, in front of two walls without edges: the image border is not an edge.
    const std::vector<TestView> apart{{{0, 0, 0}, screen(0, 2, 20)},
                                      {{0, 0, 0}, screen(0, -2, 20), -1}};
    std::vector<TestView> views = apart;
    views[1].surface = [](Vec3d eye, Vec3d ray) -> Hit {
        return {(-2 - eye.z) / ray.z, {0, 0, 1}};
    };
    const TriangleMesh all = fused<Cpu>(views, false);
    EXPECT_GT(count(all, [](Vec3f p) { return p.z < -1.9f; }), 1000);
    expect_same_bytes(fused<Cpu>(views, true), all);
}

SurfacePixel pixel_on_plane(double slope, double x, double extra = 0) {
    // z = 2 + slope x, seen by the ray (x', 0, 1).
    const double z = 2 / (1 - slope * x);
    return {vec_cast<float>(Vec3d{x, 0, 1}), static_cast<float>(z + extra),
            vec_cast<float>(Vec3d{3 * slope, 0, -3})};
}

constexpr float kQuarter = 0.25f;  // of a pixel

TEST(PixelTrust, PlanesAreSmoothAtAnySlant) {
    for (const double slope : {0.0, 0.7, -5.0, 50.0}) {
        const SurfacePixel a = pixel_on_plane(slope, 0.005), b = pixel_on_plane(slope, 0.015);
        EXPECT_NEAR(a.depth_at(b.ray), b.depth, 2e-5 * b.depth);
        EXPECT_FALSE(is_jump(a, b, 100, kQuarter)) << slope;
    }
    // Frontally, a quarter of a pixel at depth 2 is 0.005; at 60 degrees, twice as much.
    const SurfacePixel flat = pixel_on_plane(0, 0);
    EXPECT_NEAR(flat.width(100), 0.02, 1e-7);
    EXPECT_FALSE(is_jump(flat, pixel_on_plane(0, 0.01, 0.0049), 100, kQuarter));
    EXPECT_TRUE(is_jump(flat, pixel_on_plane(0, 0.01, 0.0051), 100, kQuarter));
    EXPECT_TRUE(is_jump(pixel_on_plane(0, 0.01, -0.0051), flat, 100, kQuarter));
    const double slope = std::tan(M_PI / 3);
    EXPECT_NEAR(pixel_on_plane(slope, 0).width(100), 0.04, 1e-6);
    EXPECT_NEAR(pixel_on_plane(1e4, 0).width(100), 0.2, 1e-6) << "ten times at most";
}

TEST(PixelTrust, FoldsAreSmoothJumpsAreNot) {
    // It suffices that either plane predicts the other pixel: one of the two normals may be wrong.
    SurfacePixel a = pixel_on_plane(2, 0), b = pixel_on_plane(2, 0.01);
    b.normal = {0, 0, -1};
    EXPECT_FALSE(is_jump(a, b, 100, kQuarter));
    EXPECT_FALSE(is_jump(b, a, 100, kQuarter));
    a.normal = {0, 0, -1};
    EXPECT_TRUE(is_jump(a, b, 100, kQuarter));
    // The wider pixel counts: one is seen edge-on and is 0.2 wide.
    b = {a.ray, a.depth + 0.04f, {1, 0, 0}};
    EXPECT_FALSE(is_jump(a, b, 100, kQuarter));
    EXPECT_FALSE(is_jump(b, a, 100, kQuarter));
    b.depth = a.depth + 0.06f;
    EXPECT_TRUE(is_jump(a, b, 100, kQuarter));
    b.ray = pixel_on_plane(2, 0.01).ray;
    // Without a normal, the plane is frontal.
    a.normal = b.normal = {};
    EXPECT_EQ(a.depth_at(b.ray), a.depth);
    b.depth = a.depth;
    EXPECT_FALSE(is_jump(a, b, 100, kQuarter));
    b.depth = 0;
    EXPECT_TRUE(is_jump(a, b, 100, kQuarter));
    b.depth = std::nanf("");
    EXPECT_TRUE(is_jump(a, b, 100, kQuarter));
    // A plane seen edge-on predicts no depth in front.
    b.depth = a.depth, b.normal = {1, 0, 0};
    EXPECT_GT(b.depth_at({-0.5f, 0, 1}), 0);
}

template <class Device>
std::vector<float> weights(const Surface& surface, DepthRules rules = rules_with(true)) {
    RenderedImages<Device> images;
    CleanDepth<Device> clean;
    const TestView view{{0, 0, 0}, surface};
    render(view, images);
    clean_depth(images, camera_of(view), {}, rules, clean);
    return to_host(clean.weight);
}

TEST(PixelTrust, RimsAreTrustedWhatIsBehindThemIsNot) {
    // The edge at x = 0 lies between columns 59 and 60; the screen ends left of it.
    const std::vector<float> weight = weights<Cpu>(kStep);
    for (int i = 0; i < kWidth * kHeight; ++i)
        ASSERT_EQ(weight[static_cast<std::size_t>(i)],
                  i % kWidth == 60 ? kDoubtedWeight : kTrustedWeight)
            << i;
    // The same edge horizontally, between rows 29 and 30.
    const Surface turned = [](Vec3d, Vec3d ray) -> Hit {
        return {ray.y < 0 ? 2 : 2.1, {0, 0, -1}};
    };
    const std::vector<float> rows = weights<Cpu>(turned);
    for (int y = 0; y < kHeight; ++y)
        EXPECT_EQ(rows[static_cast<std::size_t>(y) * kWidth + 7],
                  y == 30 ? kDoubtedWeight : kTrustedWeight)
            << y;
    // A pixel that a rule drops is not a surface in front: the box keeps only the wall, from x = 0.
    DepthRules rules = rules_with(true);
    rules.has_box = true, rules.box_min = {0, -9, 0}, rules.box_max = {9, 9, 9};
    const std::vector<float> boxed = weights<Cpu>(screen(0, 2.1, 20), rules);
    EXPECT_EQ(boxed[59], kDoubtedWeight);
    EXPECT_EQ(boxed[60], kTrustedWeight);
    // The edge is 0.1 at depth 2, five pixels.
    for (const float jump_px : {4.5f, 5.5f}) {
        DepthRules limit = rules_with(true);
        limit.jump_px = jump_px;
        EXPECT_EQ(weights<Cpu>(kStep, limit)[60], jump_px < 5 ? kDoubtedWeight : kTrustedWeight);
    }
    // Rounding of depths to steps makes no jumps.
    const Surface tilted = [](Vec3d, Vec3d ray) -> Hit {
        return {2 / (1 - 0.3 * ray.x), {0.3, 0, -1}};
    };
    DepthRules stepped = rules_with(true);
    stepped.depth_step = 0.1f;
    EXPECT_EQ(weights<Cpu>(tilted, stepped), std::vector<float>(kWidth * kHeight, kTrustedWeight));
    EXPECT_TRUE(weights<Cpu>(kStep, rules_with(false)).empty());
}

// Whether column 60 is trusted in an image whose rows are equal (or, turned, its columns), with
// these depths in columns 58 to 62 and depth 2 elsewhere.
bool trusted_at_60(const std::array<double, 5>& depths, bool turned = false) {
    const int middle = turned ? kHeight / 2 : 60;
    const Surface strip = [&](Vec3d, Vec3d ray) -> Hit {
        const double pixel = turned ? 100 * ray.y + 0.5 * kHeight : 100 * ray.x + 0.5 * kWidth;
        const int k = static_cast<int>(std::floor(pixel)) - middle + 2;
        return {k >= 0 && k < 5 ? depths[static_cast<std::size_t>(k)] : 2, {0, 0, -1}};
    };
    return weights<Cpu>(strip)[turned ? middle * kWidth + 60 : 60] == kTrustedWeight;
}

TEST(PixelTrust, ThinThingsAndSlopesBetweenFrontAndBackAreDoubted) {
    for (const bool turned : {false, true}) {
        EXPECT_TRUE(trusted_at_60({2, 2, 2, 2, 2}, turned));
        EXPECT_FALSE(trusted_at_60({2, 2, 1.5, 2, 2}, turned)) << "a pixel alone, in front";
        EXPECT_FALSE(trusted_at_60({2, 2, 2.5, 2, 2}, turned)) << "a pixel alone, behind";
        EXPECT_TRUE(trusted_at_60({2, 1.5, 1.5, 2, 2}, turned)) << "two pixels, in front";
        EXPECT_FALSE(trusted_at_60({2, 2.5, 2.5, 2, 2}, turned)) << "two pixels, behind";
        EXPECT_TRUE(trusted_at_60({0, 0, 2, 2, 2}, turned)) << "beside nothing";
        EXPECT_FALSE(trusted_at_60({2, 2, 2, 1.8, 1.6}, turned)) << "where the slope begins";
        EXPECT_FALSE(trusted_at_60({2, 1.9, 1.8, 1.7, 1.6}, turned)) << "on the slope";
        EXPECT_FALSE(trusted_at_60({2, 1.5, 1.6, 1.9, 2}, turned)) << "with both";
        EXPECT_FALSE(trusted_at_60({2, 2, 0, 2, 2}, turned)) << "without a depth";
    }
}

TEST(TrustTwin, SameBitsOnBothDevices) {
    if constexpr (kHasCuda) {
        if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
        const Surface tilted = [](Vec3d eye, Vec3d ray) -> Hit {
            // A wavy wall: its slope changes the pixel width.
            const double s = (2 - eye.z) / (ray.z - 0.6 * ray.x);
            return {s + 0.012 * std::sin(40 * ray.x * ray.y), normalize(Vec3d{0.6, 0, -1})};
        };
        const Surface all = nearest({screen(0.3, 1.5, 0.2), kStep, tilted});
        expect_same_bytes(weights<Cpu>(all), weights<Cuda>(all));
        const std::vector<TestView> three{
            {{0, 0, 0}, all}, {{0.3, 0, 0}, kStep}, {{0.6, 0, 0}, all}};
        const TriangleMesh expected = fused<Cpu>(three, true);
        expect_same_bytes(fused<Cuda>(three, true), expected);
    } else {
        GTEST_SKIP() << "build without CUDA";
    }
}

}  // namespace
}  // namespace tvsgs
