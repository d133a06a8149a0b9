// Checks the opacity field against its definition: the largest alpha on the way to a point,
// searched in double, and the product over all splats.
#include <gtest/gtest.h>

#include "mesh/splat_surfaces.h"
#include "mesh/tetrahedra/opacity_field.h"
#include "support/numeric.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using test::Random;

/// |diag(1/s) R^T (x - mean)|^2, by its definition.
double distance2(const Mat3<double>& R, Vec3d s, Vec3d mean, Vec3d x) {
    const Vec3d y = transpose_times(R, x - mean);
    double q = 0;
    for (int k = 0; k < 3; ++k) q += y[k] * y[k] / (s[k] * s[k]);
    return q;
}

/// The largest density on the segment from the origin to z ray: refines around the best of a
/// thousand points.
double largest_density(const Mat3<double>& R, Vec3d s, Vec3d mean, Vec3d ray, double z) {
    double low = 0, high = z, least = INFINITY;
    for (int round = 0; round < 6; ++round) {
        const double step = (high - low) / 1000;
        int nearest = 0;
        least = INFINITY;
        for (int i = 0; i <= 1000; ++i)
            if (const double q = distance2(R, s, mean, (low + i * step) * ray); q < least)
                least = q, nearest = i;
        high = low + std::min(1000, nearest + 1) * step;
        low += std::max(0, nearest - 1) * step;
    }
    return std::exp(-least / 2);
}

template <class Real>
void check_alpha(double tolerance) {
    Random random(3);
    int cut = 0, in_front = 0, behind = 0;
    for (int i = 0; i < 300; ++i) {
        const Mat3<double> R = rotation(normalize(random.quat()));
        // Round splats, surfels of a thousandth and disks of a millionth; the last ones pass the
        // camera.
        Vec3d s = std::exp(random.uniform(-4, -1)) * Vec3d{1, random.uniform(0.3, 1), 1};
        s.z *= std::array{0.5, 1e-3, 1e-4}[static_cast<std::size_t>(i % 3)];
        const Vec3d mean{random.uniform(-1, 1), random.uniform(-1, 1),
                         i % 7 ? random.uniform(1, 3) : random.uniform(-0.2, 0.2)};
        // A ray that passes nearby, and points in front of, inside and behind the splat.
        Vec3d target = mean + R * (s * random.normal3());
        target.z = std::abs(target.z) + 0.01;
        const Vec3d ray = target / target.z;
        const double z = target.z * random.uniform(0.9, 1.1);
        const double expected_density = largest_density(R, s, mean, ray, z);
        const double opacity = 0.9;
        const double alpha = opacity * expected_density;
        const double expected = alpha < kMinAlpha ? 0 : std::min(alpha, 0.99);
        const RayGaussian<Real> g = ray_gaussian(mat_cast<Real>(R), vec_cast<Real>(s),
                                                 vec_cast<Real>(mean), static_cast<Real>(opacity));
        const double found = alpha_up_to(g, vec_cast<Real>(ray), static_cast<Real>(z));
        if (std::abs(alpha - kMinAlpha) < 1e-4) continue;  // on the cut
        // Effect of rounding the point's depth, in standard deviations.
        const double reach = sizeof(Real) == 4 ? 3e-7 * z / std::min({s.x, s.y, s.z}) : 0;
        EXPECT_NEAR(found, expected, tolerance + reach) << i;
        cut += expected == 0, in_front += z < target.z && expected > 0,
            behind += z > target.z && expected > 0;
    }
    EXPECT_GT(cut, 20);
    EXPECT_GT(in_front, 30);
    EXPECT_GT(behind, 60);
}

TEST(AlphaUpTo, IsTheLargestOnTheWay) {
    check_alpha<double>(1e-6);  // of the search
    check_alpha<float>(1e-4);
}

TEST(AlphaUpTo, ByHand) {
    // A round splat of deviation 0.1 at depth 2 on the optical axis.
    const Mat3<double> one = mat_cast<double>(Mat3f{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}});
    const auto g = ray_gaussian<double>(one, {0.1, 0.1, 0.1}, {0, 0, 2}, 1);
    EXPECT_NEAR(alpha_up_to(g, {0, 0, 1}, 1.9), std::exp(-0.5), 1e-12);  // a deviation in front
    EXPECT_NEAR(alpha_up_to(g, {0, 0, 1}, 1.85), std::exp(-1.125), 1e-12);
    EXPECT_EQ(alpha_up_to(g, {0, 0, 1}, 2.5), static_cast<double>(kMaxAlpha));  // through it
    EXPECT_EQ(alpha_up_to(g, {0, 0, 1}, 1.6), 0);                               // exp(-8) < 1 / 255
    // Beside the axis: the ray through (0.1, 0, 2) passes at a distance of 0.1 times the cosine of
    // its angle.
    EXPECT_NEAR(alpha_up_to(g, {0.05, 0, 1}, 3.0), std::exp(-0.5 / (1 + 0.0025)), 1e-12);
}

TEST(AlphaUpTo, CountsNothingBehindTheCamera) {
    const Mat3<double> one = mat_cast<double>(Mat3f{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}});
    const auto g = ray_gaussian<double>(one, {0.1, 0.1, 0.1}, {0, 0, -0.1}, 0.9);
    EXPECT_NEAR(alpha_up_to(g, {0, 0, 1}, 1.0), 0.9 * std::exp(-0.5), 1e-12);
    EXPECT_NEAR(alpha_up_to(g, {0.3, 0, 1}, 1.0), 0.9 * std::exp(-0.5), 1e-12);
}

TEST(EllipsoidImage, IsTheOutlineOfTheEllipsoid) {
    Random random(6);
    Camera camera = test::test_camera(640, 480);
    for (int i = 0; i < 40; ++i) {
        const Mat3<double> R = rotation(normalize(random.quat()));
        const Vec3d s{random.uniform(0.05, 0.3), random.uniform(0.05, 0.3),
                      i % 2 ? 1e-6 : random.uniform(0.05, 0.3)};
        const Vec3d mean{random.uniform(-2, 2), random.uniform(-2, 2), random.uniform(2, 4)};
        const double reach2 = 4;
        const EllipsoidImage<double> image = ellipsoid_image(camera, R, s, mean, reach2);
        ASSERT_TRUE(image.bounded);
        double most = 0, left = 0, top = 0, depth = 0;
        const double det = image.shape.xx * image.shape.yy - image.shape.xy * image.shape.xy;
        for (int k = 0; k < 20000; ++k) {
            const Vec3d p = mean + R * (2.0 * (s * normalize(random.normal3())));
            const double x = double(camera.fx_px) * p.x / p.z + double(camera.cx_px) - image.mean.x,
                         y = double(camera.fy_px) * p.y / p.z + double(camera.cy_px) - image.mean.y;
            const Sym2<double>& S = image.shape;
            most = std::max(most, (S.yy * x * x - 2 * S.xy * x * y + S.xx * y * y) / det);
            left = std::max(left, -x), top = std::max(top, -y);
            depth = std::max(depth, mean.z - p.z);
        }
        EXPECT_LE(most, 1 + 1e-6) << i;  // all inside, and some on its boundary all around
        EXPECT_GT(most, 0.99) << i;
        EXPECT_NEAR(left / std::sqrt(image.shape.xx), 1, 0.02) << i;
        EXPECT_NEAR(top / std::sqrt(image.shape.yy), 1, 0.02) << i;
        EXPECT_NEAR(depth / image.half_depth, 1, 0.02) << i;
    }
    // Partly behind the camera's plane.
    EXPECT_FALSE(ellipsoid_image<double>(camera, mat_cast<double>(camera.camera_from_world.R),
                                         {0.1, 0.1, 1}, {0, 0, 1}, 4)
                     .bounded);
}

TEST(Sight, TwoViewsOfThreeHaveToSeeThrough) {
    EXPECT_FALSE(is_free({0, 0}));
    EXPECT_FALSE(is_free({1, 0}));
    EXPECT_TRUE(is_free({1, 1}));
    EXPECT_TRUE(is_free({2, 1}));
    EXPECT_FALSE(is_free({3, 1}));
    EXPECT_TRUE(is_free({3, 2}));
    EXPECT_FALSE(is_free({3, 0}));
}

/// Transmittance to each view whose image contains the point, by definition over all splats.
std::vector<double> brute_light(
    const Gaussians<Cpu>& g, const std::vector<View>& views, bool masks, double near, Vec3f point) {
    std::vector<double> light;
    for (const View& view : views) {
        const Camera& c = view.camera;
        const Rigid3d pose{mat_cast<double>(c.camera_from_world.R),
                           vec_cast<double>(c.camera_from_world.t)};
        const Vec3d p = pose * vec_cast<double>(point);
        if (!(p.z > near)) continue;
        const double u = double(c.fx_px) * p.x / p.z + double(c.cx_px),
                     v = double(c.fy_px) * p.y / p.z + double(c.cy_px);
        if (!(u >= 0 && u < c.width_px && v >= 0 && v < c.height_px)) continue;
        if (masks && !view.mask.empty() && view.mask.at(int(u), int(v)) < 128) continue;
        double T = 1;
        for (std::size_t i = 0; i < g.means.size(); ++i) {
            const Vec3d mean = pose * vec_cast<double>(g.means[i]);
            Vec3d s = exp(vec_cast<double>(g.log_scales[i]));
            double o = 1 / (1 + std::exp(-double(g.opacity_logits[i])));
            if (!g.filter.empty()) {
                const double f = double(g.filter[i]);
                for (int k = 0; k < 3; ++k) {
                    const double wide = std::hypot(s[k], f);
                    o *= s[k] / wide, s[k] = wide;
                }
            }
            if (!(mean.z > near) || !is_finite(mean) || !is_finite(s)) continue;
            const Mat3<double> R = pose.R * rotation(normalize(quat_cast<double>(g.quats[i])));
            // The peak along the ray, by the derivative of the exponent.
            const Vec3d ray = p / p.z;
            double a = 0, b = 0;
            const Vec3d m = transpose_times(R, mean), r = transpose_times(R, ray);
            for (int k = 0; k < 3; ++k)
                a += m[k] * r[k] / (s[k] * s[k]), b += r[k] * r[k] / (s[k] * s[k]);
            const double z = std::clamp(a / b, 0.0, p.z);
            const double alpha = o * std::exp(-distance2(R, s, mean, z * ray) / 2);
            if (alpha >= double(kMinAlpha)) T *= 1 - std::min(alpha, 0.99);
        }
        light.push_back(T);
    }
    return light;
}

/// Splats of all shapes and three views; the second view has a mask.
struct Field {
    Gaussians<Cpu> gaussians = test::random_gaussians(400, 5, 0.08);
    std::vector<View> views;
    std::vector<Vec3f> points;

    Field() {
        for (int i = 0; i < 400; i += 2)  // surfels
            gaussians.log_scales[std::size_t(i)].z = gaussians.log_scales[std::size_t(i)].x - 7;
        for (const int big : {7, 8, 9})  // one reaches behind cameras
            gaussians.log_scales[std::size_t(big)] = {1.5f, 0.5f, -0.5f};
        for (int i = 0; i < 3; ++i) {
            views.emplace_back();
            views.back().camera = test::test_camera(70 + 16 * i, 50, 0.3f + 1.1f * float(i));
        }
        views[1].mask = ImageU8(86, 50, 1, 255);
        for (int y = 0; y < 50; ++y)
            for (int x = 0; x < 40; ++x) views[1].mask.at(x, y) = 0;
        Random random(8);
        for (int i = 0; i < 1500; ++i)
            points.push_back(vec_cast<float>(random.uniform(0.5, 4) * random.normal3()));
    }
};

std::vector<Sight> seen(const Gaussians<Cpu>& g,
                        const FieldViews& views,
                        const std::vector<Vec3f>& points) {
    Buffer<Sight, Cpu> sights;
    see_points(field_splats(g), views, to_device<Cpu>(points), sights);
    return to_host(sights);
}

/// Checks each view alone, then all together.
void expect_definition(const Field& field, bool masks, float near) {
    std::vector<int> views(field.points.size(), 0), clear(field.points.size(), 0);
    std::vector<bool> close(field.points.size(), false);
    int visible = 0, hidden = 0;
    for (const View& view : field.views) {
        const std::vector<View> one{view};
        const auto found = seen(field.gaussians, {one, masks, near}, field.points);
        for (std::size_t i = 0; i < found.size(); ++i) {
            const std::vector<double> light =
                brute_light(field.gaussians, one, masks, double(near), field.points[i]);
            ASSERT_EQ(found[i].views, static_cast<int>(light.size())) << i;
            views[i] += found[i].views, clear[i] += found[i].clear;
            if (light.empty()) continue;
            // A splat at its cut-off in one implementation alone changes the transmittance by 1 /
            // 255.
            close[i] = close[i] || std::abs(light[0] - 0.5) < 0.004;
            EXPECT_TRUE(close[i] || found[i].clear == (light[0] > 0.5)) << i << ' ' << light[0];
            ++visible, hidden += light[0] < 0.5;
        }
    }
    EXPECT_GT(visible, 500);
    EXPECT_GT(hidden, 150);
    EXPECT_LT(std::count(close.begin(), close.end(), true), 60);
    const auto all = seen(field.gaussians, {field.views, masks, near}, field.points);
    for (std::size_t i = 0; i < all.size(); ++i)
        EXPECT_EQ(is_free(all[i]), clear[i] >= (views[i] > 2 ? 2 : 1));
}

TEST(OpacityField, IsTheProductOverAllSplats) {
    Field field;
    expect_definition(field, true, 0.2f);
    expect_definition(field, false, 2);  // without masks; much lies in front of the near plane
    field.gaussians.filter.resize(400);
    Random random(4);
    for (float& f : field.gaussians.filter.span()) f = static_cast<float>(random.uniform(0, 0.05));
    expect_definition(field, true, 0.2f);
}

TEST(OpacityField, SplatsBelowAPixelHideWhatIsBehind) {
    // At all positions around the border of two tiles, also off the pixels' centres.
    View view = test::view_from({0, 0, 3}, 64);
    const std::vector<View> views{view};
    for (int i = 0; i <= 40; ++i) {
        const double u = 15 + 0.05 * i + 0.01, x = 3 * (u - 32) / 64;
        Gaussians<Cpu> g;
        resize(g, 1, 0);
        test::set_flat_splat(g, 0, {x, 0, 0}, {0, 0, 1}, 0.001, 0.0001);
        const Vec3d behind = 1.1 * Vec3d{x, 0, -3} + Vec3d{0, 0, 3};
        const std::vector<Vec3f> points{vec_cast<float>(behind), {float(x), 0, 0.1f}};
        const auto sights = seen(g, {views, true, 0.2f}, points);
        EXPECT_FALSE(is_free(sights[0])) << u;
        EXPECT_TRUE(is_free(sights[1])) << u;
    }
}

TEST(OpacityField, HostileSplatsAreLeftOut) {
    Field field;
    const auto before = seen(field.gaussians, {field.views, true, 0.2f}, field.points);
    const float nan = std::nanf(""), inf = INFINITY;
    Gaussians<Cpu> g;
    resize(g, 406, 3);
    for_each_array(
        [](const SplatArray& array, const auto& from, auto& to) {
            if (array.optional) return;
            for (std::size_t k = 0; k < std::size_t(array.planes); ++k)
                for (std::size_t i = 0; i < 406; ++i)
                    to[k * 406 + i] = from[k * 400 + (i < 400 ? i : 0)];
        },
        field.gaussians, g);
    g.means[400].x = nan, g.log_scales[401].y = nan, g.quats[402].w = nan;
    g.opacity_logits[403] = nan, g.means[404] = {inf, inf, inf}, g.quats[405] = {0, 0, 0, 0};
    g.log_scales[405] = {90, 90, 90};  // its squares overflow
    const auto after = seen(g, {field.views, true, 0.2f}, field.points);
    for (std::size_t i = 0; i < before.size(); ++i) {
        EXPECT_EQ(before[i].clear, after[i].clear);
        EXPECT_EQ(before[i].views, after[i].views);
    }
}

TEST(OpacityField, NoSplatsNoViewsNoPoints) {
    Gaussians<Cpu> none;
    resize(none, 0, 0);
    const std::vector<View> views = test::views_around(3, 16);
    const Sight sight = seen(none, {views, true, 0.2f}, {{0, 0, 0}})[0];
    EXPECT_EQ(sight.views, 2);
    EXPECT_EQ(sight.clear, 2);  // and no more, because this decides
    EXPECT_TRUE(seen(none, {views, true, 0.2f}, {}).empty());
    const std::vector<View> nobody;
    EXPECT_EQ(seen(none, {nobody, true, 0.2f}, {{0, 0, 0}})[0].views, 0);
    // Non-finite points are in no image.
    EXPECT_EQ(seen(none, {views, true, 0.2f}, {{std::nanf(""), 0, 0}, {INFINITY, 0, 0}})[1].views,
              0);
}

TEST(OpacityField, CrossingsLieWhereHalfOfTheLightGetsThrough) {
    // One splat before one camera: T = 1 - o exp(-y^2 / 2) up to its centre.
    Gaussians<Cpu> g;
    resize(g, 1, 0);
    test::set_flat_splat(g, 0, {0, 0, 0}, {0, 0, 1}, 0.5, 0.01);
    const std::vector<View> views{test::view_from({0, 0, 3}, 32)};
    auto free_ends = to_device<Cpu>(std::vector<Vec3f>{{0, 0, 0.1f}});
    auto inside_ends = to_device<Cpu>(std::vector<Vec3f>{{0, 0, -0.1f}});
    find_crossings(field_splats(g), {views, true, 0.2f}, 14, free_ends, inside_ends);
    const double o = 1 / (1 + std::exp(-6.0)), y = std::sqrt(2 * std::log(2 * o));
    EXPECT_NEAR(free_ends[0].z, 0.01 * y, 0.2 / (1 << 15) + 3e-6);  // the depth is rounded near 3
    EXPECT_EQ(free_ends[0].z, inside_ends[0].z);
}

TEST(OpacityFieldTwin, SameSights) {
    if (const std::string why = test::no_cuda(); !why.empty()) GTEST_SKIP() << why;
    if constexpr (kHasCuda) {
        Field field;
        const FieldViews views{field.views, true, 0.2f};
        const auto expected = seen(field.gaussians, views, field.points);
        FieldSplats<Cuda> splats;
        copy(field_splats(field.gaussians), splats);
        Buffer<Sight, Cuda> sights;
        see_points(splats, views, to_device<Cuda>(field.points), sights);
        const auto found = to_host(sights);
        ASSERT_EQ(found.size(), expected.size());
        int differing = 0;  // near the threshold
        for (std::size_t i = 0; i < found.size(); ++i)
            differing += is_free(found[i]) != is_free(expected[i]);
        EXPECT_LE(differing, 3);

        // Segments between free points and others.
        std::vector<Vec3f> free_ends, inside_ends;
        for (std::size_t i = 0; i < expected.size(); ++i) {
            if (expected[i].views == 0) continue;
            auto& ends = is_free(expected[i]) ? free_ends : inside_ends;
            ends.push_back(field.points[i]);
        }
        free_ends.resize(std::min(free_ends.size(), inside_ends.size()));
        inside_ends.resize(free_ends.size());
        auto a = to_device<Cpu>(free_ends), b = to_device<Cpu>(inside_ends);
        auto c = to_device<Cuda>(free_ends), d = to_device<Cuda>(inside_ends);
        find_crossings(field_splats(field.gaussians), views, 8, a, b);
        find_crossings(splats, views, 8, c, d);
        const auto on_gpu = to_host(c);
        int elsewhere = 0;  // where rounding decided a step
        for (std::size_t i = 0; i < on_gpu.size(); ++i) elsewhere += norm(on_gpu[i] - a[i]) > 1e-5f;
        EXPECT_LE(elsewhere, static_cast<int>(on_gpu.size() / 50));
    }
}

}  // namespace
}  // namespace tvsgs
