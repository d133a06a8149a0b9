// The two multi-view terms at single pixels: derivatives compared with differences in double, and
// surfaces known in closed form.
#include <functional>
#include <set>

#include "optim/losses/multiview_math.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;
using test::Random;

constexpr int kWidth = 64, kHeight = 48;

Camera view_camera(float angle) {
    Camera c = test::test_camera(kWidth, kHeight, angle);
    c.fx_px = 70, c.fy_px = 72;
    return c;
}

struct Pose {
    Vec3d centre;
    Mat3<double> R;  // world from camera
};
Pose pose(const Camera& c) {
    const Mat3<double> R = transpose(mat_cast<double>(c.camera_from_world.R));
    return {-(R * vec_cast<double>(c.camera_from_world.t)), R};
}
Vec3d world_ray(const Camera& c, double x, double y) {
    return pose(c).R * Vec3d{(x - c.cx_px) / c.fx_px, (y - c.cy_px) / c.fy_px, 1};
}

/// z-depth along a ray of direction `ray` (z = 1 in the camera) from `origin`; 0: missed.
using Surface = std::function<double(Vec3d origin, Vec3d ray)>;

const Vec3d kPlaneNormal = normalize(Vec3d{0.3, -0.2, -1});  // world; faces the cameras
constexpr double kPlaneOffset = 0.1;                         // n . X = offset

Surface plane(double scale = 1) {
    return [scale](Vec3d o, Vec3d r) {
        return scale * (kPlaneOffset - dot(kPlaneNormal, o)) / dot(kPlaneNormal, r);
    };
}
Surface sphere(double scale = 1) {
    return [scale](Vec3d o, Vec3d r) {  // radius 1.5 around the origin
        const double a = dot(r, r), b = dot(o, r), c = dot(o, o) - 2.25, d = b * b - a * c;
        return d < 0 ? 0 : scale * (-b - std::sqrt(d)) / a;
    };
}

std::vector<double> depth_map(const Camera& c, const Surface& surface) {
    std::vector<double> depth;
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x)
            depth.push_back(surface(pose(c).centre, world_ray(c, x + 0.5, y + 0.5)));
    return depth;
}

Vec3d pixel_ray_d(const Camera& c, int x, int y) {
    return {(x + 0.5 - c.cx_px) / c.fx_px, (y + 0.5 - c.cy_px) / c.fy_px, 1};
}

/// Texture of the world, smooth at the scale of a pixel: intensities between 0 and 1.
double texture(Vec3d p) {
    return 0.5 + 0.2 * std::sin(9 * p.x + 2 * p.y) + 0.15 * std::sin(11 * p.y - 3 * p.x + 1) +
           0.1 * std::sin(7 * p.x + 8 * p.z);
}

struct Photo {
    std::vector<double> pixels;
    double operator()(int x, int y) const {
        return x >= 0 && x < kWidth && y >= 0 && y < kHeight
                   ? pixels[static_cast<std::size_t>(y * kWidth + x)]
                   : 0;
    }
};
Photo photograph(const Camera& c, const Surface& surface) {
    Photo photo;
    const std::vector<double> depth = depth_map(c, surface);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x)
            photo.pixels.push_back(
                texture(pose(c).centre + depth[static_cast<std::size_t>(y * kWidth + x)] *
                                             world_ray(c, x + 0.5, y + 0.5)));
    return photo;
}

struct Errors {
    double mean = 0, most = 0;
    int count = 0;
};

/// Reprojection distances of pixels whose sample has depth in the other view.
Errors reprojection_errors(const Surface& seen_by_reference, const Surface& seen_by_other) {
    const Camera a = view_camera(0), b = view_camera(0.25f);
    const auto pair = view_pair<double>(a, b, 0.1);
    const std::vector<double> da = depth_map(a, seen_by_reference),
                              db = depth_map(b, seen_by_other);
    Errors e;
    for (int at = 0; at < kWidth * kHeight; ++at) {
        const auto r = reproject(pair, pixel_ray_d(a, at % kWidth, at / kWidth),
                                 da[static_cast<std::size_t>(at)],
                                 [&](int i) { return db[static_cast<std::size_t>(i)]; });
        if (!r.valid) continue;
        e.mean += r.distance, e.most = std::max(e.most, r.distance), ++e.count;
    }
    e.mean /= e.count;
    return e;
}

TEST(Reprojection, APlaneComesBackToWhereItStarted) {
    const Errors truth = reprojection_errors(plane(), plane());
    // Bilinear depth is not exact on a slanted plane, whose inverse depth is linear. The error is
    // an eighth of the second derivative of depth (below 0.002 units / px^2 here) times f b / z^2
    // (5 px per unit). Excludes the border, where samples are clamped.
    EXPECT_LT(truth.mean, 2e-3);
    EXPECT_GT(truth.count, kWidth * kHeight / 2);
    // One percent of the depth is 4 cm of 4 m: about 0.15 px with a baseline of 1 m and f = 70 px.
    EXPECT_GT(reprojection_errors(plane(), plane(1.01)).mean, 20 * truth.mean);
    EXPECT_GT(reprojection_errors(plane(1.01), plane()).mean, 20 * truth.mean);
}

TEST(Reprojection, AFrontalPlaneIsExact) {
    // Without slant, depth is constant in two parallel cameras, and bilinear samples are exact.
    Camera a = view_camera(0), b = a;
    b.camera_from_world.t.x -= 0.5f;
    const auto pair = view_pair<double>(a, b, 0.1);
    int count = 0;
    for (int at = 0; at < kWidth * kHeight; ++at) {
        const auto r =
            reproject(pair, pixel_ray_d(a, at % kWidth, at / kWidth), 4.0, [](int) { return 4.0; });
        if (!r.valid) continue;
        ++count;
        ASSERT_LT(r.distance, 1e-10);
    }
    EXPECT_GT(count, kWidth * kHeight / 2);
}

TEST(Reprojection, ASphereComesBackAndAnotherDoesNot) {
    const Errors truth = reprojection_errors(sphere(), sphere());
    EXPECT_GT(truth.count, 300);
    // Bilinear depth of a curved surface: worse near its outline, where few pixels are.
    EXPECT_LT(truth.mean, 0.02);
    EXPECT_GT(reprojection_errors(sphere(), sphere(1.01)).mean, 5 * truth.mean);
}

TEST(Reprojection, WhatCannotBeComparedIsNotValid) {
    const Camera a = view_camera(0), b = view_camera(0.25f);
    const auto pair = view_pair<double>(a, b, 0.1);
    const Vec3d ray = pixel_ray_d(a, 32, 24);
    const double depth = depth_map(a, plane())[24 * kWidth + 32];
    const std::vector<double> there = depth_map(b, plane());
    const auto read = [&](int i) { return there[static_cast<std::size_t>(i)]; };
    const auto r = reproject(pair, ray, depth, read);
    ASSERT_TRUE(r.valid);
    EXPECT_FALSE(reproject(pair, ray, 0.0, read).valid) << "no depth here";
    EXPECT_FALSE(reproject(pair, ray, -depth, read).valid);
    EXPECT_FALSE(reproject(pair, ray, std::nan(""), read).valid);
    EXPECT_FALSE(reproject(pair, ray, 100 * depth, read).valid) << "outside of the other view";
    EXPECT_FALSE(
        reproject(pair, ray, depth, [&](int i) { return i == r.at[2] ? 0 : read(i); }).valid)
        << "no depth there";
    EXPECT_FALSE(reproject(pair, ray, depth, [&](int i) { return 1.2 * read(i); }).valid)
        << "more than a pixel off";
    auto strict = pair;
    strict.min_depth = 5;
    EXPECT_FALSE(reproject(strict, ray, depth, read).valid) << "too near to the other view";
}

TEST(Reprojection, DerivativesAgreeWithDifferences) {
    const Camera a = view_camera(0), b = view_camera(0.25f);
    const auto pair = view_pair<double>(a, b, 0.1);
    const std::vector<double> da = depth_map(a, plane());
    std::vector<double> db = depth_map(b, plane());
    Random random(3);
    // Noise, so that samples have a slope.
    for (double& d : db) d *= 1 + random.uniform(-0.02, 0.02);
    int checked = 0;
    for (int at = 0; at < kWidth * kHeight; at += 17) {
        const Vec3d ray = pixel_ray_d(a, at % kWidth, at / kWidth);
        const double depth = da[static_cast<std::size_t>(at)];
        const auto read = [&](int i) { return db[static_cast<std::size_t>(i)]; };
        const auto r = reproject(pair, ray, depth, read);
        if (!r.valid || r.distance < 0.05 || r.distance > 0.9) continue;
        const auto g = reproject_vjp(pair, ray, r, 1.3);
        // Steps that cross into the next pixel of the other view change the slope.
        const auto moved = reproject(pair, ray, depth * (1 + 1e-5), read);
        if (moved.at[0] != r.at[0]) continue;
        ++checked;
        const double by_depth = central_difference(
            [&](double h) { return 1.3 * reproject(pair, ray, depth + h, read).distance; }, 1e-6);
        EXPECT_TRUE(close(g.dL_ddepth, by_depth, 1e-5, 1)) << at;
        for (int k = 0; k < 4; ++k) {
            const double by_there = central_difference(
                [&](double h) {
                    return 1.3 * reproject(pair, ray, depth, [&](int i) {
                                     return read(i) + (i == r.at[k] ? h : 0);
                                 }).distance;
                },
                1e-6);
            double share = 0;  // at the border a pixel may occur twice
            for (int j = 0; j < 4; ++j)
                if (r.at[j] == r.at[k]) share += r.share[j];
            EXPECT_TRUE(close(share * g.dL_dother_depth, by_there, 1e-5, 1)) << at << ' ' << k;
        }
    }
    EXPECT_GT(checked, 30);
}

/// Plane of a pixel in its camera's frame: n . X = -d.
struct CameraPlaneD {
    Vec3d normal;
    double distance;
};
CameraPlaneD camera_plane_of(const Camera& c) {
    const Vec3d n = mat_cast<double>(c.camera_from_world.R) * kPlaneNormal;
    return {n, -(kPlaneOffset - dot(kPlaneNormal, pose(c).centre))};
}

struct PatchScene {
    Camera a = view_camera(0), b = view_camera(0.25f);
    ViewPair<double> pair = view_pair<double>(a, b, 0.1);
    Photo photo_a, photo_b;
    CameraPlaneD plane;
    Vec2<double> shift{0.5, 0.5};

    explicit PatchScene(const Surface& surface = tvsgs::plane())
        : photo_a(photograph(a, surface)),
          photo_b(photograph(b, surface)),
          plane(camera_plane_of(a)) {}

    PatchScore<double> score(int x, int y, Vec3d n, double d) const {
        return patch_score(pair, {x + 0.5, y + 0.5}, n, d, photo_a, photo_b, shift);
    }
    PatchScore<double> score(int x, int y, double scale = 1) const {
        return score(x, y, plane.normal, scale * plane.distance);
    }
};

TEST(PatchScore, IsZeroOnATexturedPlaneAndRisesAwayFromIt) {
    const PatchScene scene;
    ASSERT_GT(scene.plane.distance, 0);
    int count = 0;
    for (int y = 12; y < 36; y += 4)
        for (int x = 20; x < 44; x += 4) {
            const auto truth = scene.score(x, y);
            ASSERT_TRUE(truth.valid);
            // Bilinear samples of a texture with at least 10 px per period.
            EXPECT_LT(truth.error, 1e-3) << x << ' ' << y;
            const auto farther = scene.score(x, y, 1.02), nearer = scene.score(x, y, 0.98);
            EXPECT_GT(farther.error, 3 * truth.error) << x << ' ' << y;
            EXPECT_GT(nearer.error, 3 * truth.error) << x << ' ' << y;
            EXPECT_GT(farther.derror_ddistance, 0);  // the gradient points away from the true plane
            EXPECT_LT(nearer.derror_ddistance, 0);
            const Vec3d tilted = normalize(scene.plane.normal + Vec3d{0.4, 0, 0});
            const Vec3d ray = pixel_ray_d(scene.a, x, y);
            // through the same point, so that only the tilt differs
            const double d = scene.plane.distance * dot(tilted, ray) / dot(scene.plane.normal, ray);
            EXPECT_GT(scene.score(x, y, tilted, d).error, truth.error);
            ++count;
        }
    EXPECT_EQ(count, 36);
}

TEST(PatchScore, TangentPlanesMatchOnASphere) {
    const PatchScene scene(sphere());
    const std::vector<double> depth = depth_map(scene.a, sphere());
    int count = 0;
    for (int y = 16; y < 32; y += 4)
        for (int x = 26; x < 40; x += 4) {
            const Vec3d p =
                depth[static_cast<std::size_t>(y * kWidth + x)] * pixel_ray_d(scene.a, x, y);
            // The sphere's centre is the origin of the world.
            const Vec3d n = normalize(p - vec_cast<double>(scene.a.camera_from_world.t));
            const auto truth = scene.score(x, y, n, -dot(n, p));
            ASSERT_TRUE(truth.valid);
            // A patch of 7 px spans 0.2 units at a radius of 1.5: the tangent plane deviates by 3
            // mm, a tenth of a pixel.
            EXPECT_LT(truth.error, 0.02) << x << ' ' << y;
            EXPECT_GT(scene.score(x, y, n, -1.03 * dot(n, p)).error, truth.error);
            EXPECT_GT(scene.score(x, y, n, -0.97 * dot(n, p)).error, truth.error);
            ++count;
        }
    EXPECT_EQ(count, 16);
}

TEST(PatchScore, DerivativesAgreeWithDifferences) {
    const PatchScene scene;
    Random random(4);
    int checked = 0;
    for (int trial = 0; trial < 60; ++trial) {
        const int x = 18 + trial % 28, y = 10 + trial % 27;
        const Vec3d n = 0.8 * (scene.plane.normal + 0.1 * random.normal3());
        const double d = 0.8 * scene.plane.distance * random.uniform(0.97, 1.03);
        const auto s = scene.score(x, y, n, d);
        if (!s.valid || s.error < 1e-3) continue;
        ++checked;
        // The bilinear surface has kinks between pixels; steps of 1e-7 rarely cross one, and leave
        // seven digits.
        for (int k = 0; k < 3; ++k)
            EXPECT_TRUE(close(s.derror_dnormal[k],
                              central_difference(
                                  [&](double h) {
                                      Vec3d m = n;
                                      m[k] += h;
                                      return scene.score(x, y, m, d).error;
                                  },
                                  1e-7),
                              1e-4, 0.1))
                << trial << ' ' << k;
        EXPECT_TRUE(close(
            s.derror_ddistance,
            central_difference([&](double h) { return scene.score(x, y, n, d + h).error; }, 1e-7),
            1e-4, 0.1))
            << trial;
    }
    EXPECT_GT(checked, 40);
}

TEST(PatchScore, OnlyTheQuotientOfNormalAndDistanceCounts) {
    const PatchScene scene;
    const auto one = scene.score(30, 20, 1.01),
               half = scene.score(30, 20, 0.5 * scene.plane.normal, 0.505 * scene.plane.distance);
    EXPECT_NEAR(one.error, half.error, 1e-12);
    // No change when (normal, distance) is scaled.
    EXPECT_NEAR(dot(one.derror_dnormal, scene.plane.normal) +
                    one.derror_ddistance * 1.01 * scene.plane.distance,
                0, 1e-9);
}

TEST(PatchScore, InvertedMatchesFlatDoesNot) {
    PatchScene scene;
    const double error = scene.score(30, 20).error;
    for (double& v : scene.photo_b.pixels) v = 0.9 - 0.5 * v;
    // NCC^2 is invariant to gain, offset and sign, except for the 1e-8 in its denominator.
    EXPECT_NEAR(scene.score(30, 20).error, error, 1e-5);
    std::fill(scene.photo_b.pixels.begin(), scene.photo_b.pixels.end(), 0.5);
    EXPECT_FALSE(scene.score(30, 20).valid);
    EXPECT_FALSE(scene.score(30, 20, scene.plane.normal, 0).valid);
    EXPECT_FALSE(scene.score(30, 20, scene.plane.normal, std::nan("")).valid);
}

TEST(PatchScore, FinerImagesAgreeToo) {
    // A grey image of twice the size: the lenses scale, the plane does not.
    const PatchScene scene;
    Camera a = scaled_camera(scene.a, 2 * kWidth, 2 * kHeight);
    EXPECT_FLOAT_EQ(a.cx_px, 2 * scene.a.cx_px);
    const auto l = lens<double>(a);
    const Vec3d coarse = ray_through(lens<double>(scene.a), {30.5, 20.5}),
                fine = ray_through(l, {61.0, 41.0});
    EXPECT_NEAR(norm(coarse - fine), 0, 1e-12);
}

TEST(Permuted, VisitsEveryPlaceOnce) {
    for (std::uint32_t count : {1u, 2u, 3u, 5u, 64u, 1000u, 1025u}) {
        const Random4 key = random4(7, RandomStream::test, count);
        std::set<std::uint32_t> seen;
        for (std::uint32_t i = 0; i < count; ++i) seen.insert(permuted(i, count, key));
        EXPECT_EQ(seen.size(), count);
        EXPECT_EQ(*seen.rbegin(), count - 1);
    }
}

TEST(Permuted, ASampleSpreadsOverTheWhole) {
    // 2,000 of 100,000 under 50 keys: the mean place has a standard deviation of 0.289 / sqrt(2000)
    // = 0.0065; allow five. Each tenth gets 200 +- 13.4.
    for (std::uint64_t k = 0; k < 50; ++k) {
        const Random4 key = random4(k, RandomStream::test, 1);
        double sum = 0;
        int tenths[10] = {};
        for (std::uint32_t i = 0; i < 2000; ++i) {
            const std::uint32_t place = permuted(i, 100000, key);
            sum += place / 1e5 / 2000;
            ++tenths[place / 10000];
        }
        EXPECT_NEAR(sum, 0.5, 0.033) << k;
        for (int n : tenths) EXPECT_NEAR(n, 200, 70) << k;
    }
}

}  // namespace
}  // namespace tvsgs
