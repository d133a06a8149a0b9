// Tests profiles of splats along rays and the median depth of a ray: derivatives, limits and the
// range of single precision, formula by formula.
#include <functional>
#include <vector>

#include "render/depth/median_math.h"
#include "render/rade/ray_profile_math.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;

template <class Real>
struct SplatCase {
    Quat<Real> quat;
    Vec3<Real> log_scales, p;  // p: the mean in the camera's frame
};

template <class Real>
Pinhole<Real> pinhole_case() {
    Pinhole<Real> camera{};
    camera.camera_from_world.R =
        rotation(normalize(Quat<Real>{Real(0.9), Real(0.1), Real(-0.3), Real(0.2)}));
    camera.fx = 70, camera.fy = 60;
    return camera;
}

template <class Real>
RayPoint<Real> point_on_ray(const SplatCase<Real>& c, Vec2<Real> pixel, Real shift = 0) {
    return ray_point(ray_profile(pinhole_case<Real>(), rotation(normalize(c.quat)),
                                 exp(c.log_scales), c.p, shift),
                     pixel);
}

/// From the definition: P itself, r, and the quotients.
struct Along {
    double depth, square;
};
Along by_definition(const SplatCase<double>& c, Vec2<double> pixel, double shift) {
    const auto camera = pinhole_case<double>();
    const Mat3<double> R = camera.camera_from_world.R * rotation(normalize(c.quat));
    const Vec3d s = exp(c.log_scales);
    const Vec3d r{c.p.x / c.p.z + (pixel.x + shift) / camera.fx,
                  c.p.y / c.p.z + (pixel.y + shift) / camera.fy, 1};
    double rr = 0, rm = 0;
    for (int k = 0; k < 3; ++k) {
        const double along = dot(column(R, k), r) / s[k];
        rr += along * along, rm += along * dot(column(R, k), c.p) / s[k];
    }
    return {rm / rr, rr};
}

SplatCase<double> some_splat(unsigned seed) {
    test::Random random(seed);
    return {random.quat(),
            {std::log(0.1), std::log(0.04), std::log(0.01)},
            {random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(2, 5)}};
}

TEST(RayProfile, IsTheDefinition) {
    for (unsigned seed = 0; seed < 50; ++seed) {
        const SplatCase<double> c = some_splat(seed);
        test::Random random(seed + 100);
        const Vec2<double> pixel{random.uniform(-5, 5), random.uniform(-5, 5)};
        for (const double shift : {0.0, -0.5}) {
            const RayPoint<double> point = point_on_ray(c, pixel, shift);
            const Along exact = by_definition(c, pixel, shift);
            EXPECT_TRUE(close(point.depth, exact.depth, 1e-12));
            EXPECT_TRUE(close(point.inverse, std::sqrt(exact.square), 1e-11));
            EXPECT_TRUE(close(point.deviation * point.inverse, 1, 1e-12));
            EXPECT_TRUE(close(point.slip, 1 - exact.depth / c.p.z, 1e-9));
        }
    }
}

TEST(RayProfile, SinglePrecisionHoldsThinAndWideSplats) {
    // The plane of a flat splat, met at an angle; scales below and above the lower limit.
    test::Random random(3);
    for (int i = 0; i < 200; ++i) {
        SplatCase<double> c = some_splat(static_cast<unsigned>(i) + 500);
        c.log_scales = {std::log(random.uniform(0.003, 1e3)), std::log(random.uniform(0.003, 1e3)),
                        std::log(1e-7)};
        const Vec2<double> pixel{random.uniform(-2, 2), random.uniform(-2, 2)};
        const auto R = pinhole_case<double>().camera_from_world.R * rotation(normalize(c.quat));
        const Vec3d r{c.p.x / c.p.z + pixel.x / 70, c.p.y / c.p.z + pixel.y / 60, 1};
        const double facing = dot(column(R, 2), r), cosine = std::abs(facing) / norm(r);
        if (cosine < 0.05) continue;
        const SplatCase<float> single{quat_cast<float>(c.quat), vec_cast<float>(c.log_scales),
                                      vec_cast<float>(c.p)};
        const auto point = point_on_ray(single, Vec2f{float(pixel.x), float(pixel.y)});
        const double plane = dot(column(R, 2), c.p) / facing;
        // A few roundings over the cosine, and the thickness by the splat's own size.
        EXPECT_TRUE(close(double(point.depth), plane, 2e-6 / cosine + 2e-5)) << cosine;
        const double thickness = double(kLeastThickness) * c.p.z;
        EXPECT_TRUE(close(double(point.inverse), std::abs(facing) / thickness, 2e-2));
        EXPECT_GT(point.deviation, 0);
    }
}

TEST(RayProfile, EdgeOnIsAsWideAsTheSplat) {
    SplatCase<double> c{{1, 0, 0, 0}, {std::log(1e-6), std::log(0.2), std::log(0.3)}, {0, 0, 4}};
    const auto to_camera = pinhole_case<double>().camera_from_world.R;
    // World axes that the camera sees along x, y and z: thin along x, deep along z.
    const Mat3<double> R = transpose(to_camera);
    const auto point =
        ray_point(ray_profile(pinhole_case<double>(), R, exp(c.log_scales), c.p, 0.0), {0, 3});
    EXPECT_TRUE(close(point.deviation, 1 / std::sqrt(1 / 0.09 + 0.05 * 0.05 / 0.04), 1e-9));
}

/// From the mean's projection to the pixel whose ray is (x, y, 1).
Vec2<double> pixel_of(const SplatCase<double>& c, Vec2<double> ray, double shift) {
    const auto camera = pinhole_case<double>();
    return {camera.fx * (ray.x - c.p.x / c.p.z) - shift,
            camera.fy * (ray.y - c.p.y / c.p.z) - shift};
}

/// A sum of depth and 1/s^2 on several rays, and its derivatives.
struct Rays {
    std::vector<Vec2<double>> rays;
    std::vector<double> by_depth, by_square;
    double shift = -0.5;

    double value(const SplatCase<double>& c) const {
        double sum = 0;
        for (std::size_t i = 0; i < rays.size(); ++i) {
            const auto p = point_on_ray(c, pixel_of(c, rays[i], shift), shift);
            sum += by_depth[i] * p.depth + by_square[i] * p.inverse * p.inverse;
        }
        return sum;
    }
};

/// `square`: weight of 1/s^2.
void check_derivatives(const SplatCase<double>& at, double square, double step) {
    const auto camera = pinhole_case<double>();
    const Rays rays{{{at.p.x / at.p.z + 0.02, at.p.y / at.p.z - 0.01},
                     {at.p.x / at.p.z - 0.03, at.p.y / at.p.z + 0.015}},
                    {0.7, -0.4},
                    {square, 1.5 * square}};
    const Mat3<double> R = rotation(normalize(at.quat));
    const auto profile = ray_profile(camera, R, exp(at.log_scales), at.p, rays.shift);
    RayProfileGradients<double> sums{};
    for (std::size_t i = 0; i < rays.rays.size(); ++i) {
        const auto pixel = pixel_of(at, rays.rays[i], rays.shift);
        ray_point_vjp(profile, pixel, ray_point(profile, pixel), rays.by_depth[i],
                      rays.by_square[i], sums);
    }
    const auto g = ray_profile_vjp(camera, R, exp(at.log_scales), at.p, sums);
    const auto by_quat = rotation_vjp(at.quat, g.dL_dR);
    using Move = std::function<void(SplatCase<double>&, double)>;
    const auto check = [&](double analytic, const Move& move) {
        const auto moved = [&](double h) {
            SplatCase<double> c = at;
            move(c, h);
            return rays.value(c);
        };
        EXPECT_TRUE(close(analytic, central_difference(moved, step), 1e-6, 1e-2));
    };
    for (int k = 0; k < 3; ++k) {
        check(g.dL_dp[k], [k](auto& c, double h) { c.p[k] += h; });
        check(g.dL_dlog_s[k], [k](auto& c, double h) { c.log_scales[k] += h; });
    }
    check(by_quat.w, [](auto& c, double h) { c.quat.w += h; });
    check(by_quat.x, [](auto& c, double h) { c.quat.x += h; });
    check(by_quat.y, [](auto& c, double h) { c.quat.y += h; });
    check(by_quat.z, [](auto& c, double h) { c.quat.z += h; });
}

TEST(RayProfile, VjpAgainstDifferences) {
    for (unsigned seed = 0; seed < 20; ++seed) check_derivatives(some_splat(seed), 2e-4, 1e-4);
}

TEST(RayProfile, VjpWhereAScaleIsTooThin) {
    for (unsigned seed = 0; seed < 5; ++seed) {
        SplatCase<double> c = some_splat(seed);
        c.log_scales = {std::log(0.1), std::log(1e-7), std::log(0.03)};
        check_derivatives(c, 2e-9, 1e-4);
    }
}

// --- Light along a ray ---

struct OnRay {
    double alpha, depth, deviation;
};

/// sqrt(1 - g) in front of the centre, (1 - a) / sqrt(1 - g) behind, without a cut-off.
double light(const std::vector<OnRay>& splats, double t) {
    double T = 1;
    for (const OnRay& s : splats) {
        const double x = (t - s.depth) / s.deviation, g = s.alpha * std::exp(-x * x / 2);
        T *= t <= s.depth ? std::sqrt(1 - g) : (1 - s.alpha) / std::sqrt(1 - g);
    }
    return T;
}

/// Solved to 1e-13; 0: none.
double median_by_bisection(const std::vector<OnRay>& splats) {
    double low = 0, high = 100;
    if (light(splats, high) > 0.5) return 0;
    while (high - low > 1e-13 * high && 0.5 * (low + high) != low && 0.5 * (low + high) != high) {
        const double middle = 0.5 * (low + high);
        (light(splats, middle) > 0.5 ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

/// The splats that count, in order.
std::vector<OnRay> with_part(const std::vector<OnRay>& splats) {
    double T = 1;
    std::size_t count = 0;
    while (count < splats.size() && T >= double(kDepthTransmittance))
        T *= 1 - splats[count++].alpha;
    return {splats.begin(), splats.begin() + std::ptrdiff_t(count)};
}

/// As the passes over a list do.
template <class Real>
Real median_by_search(const std::vector<OnRay>& all, int* turns = nullptr) {
    const std::vector<OnRay> splats = with_part(all);
    MedianRange<Real> range;
    const auto point = [](const OnRay& s) {
        return RayPoint<Real>{Real(s.depth), Real(s.deviation), Real(1 / s.deviation), 0};
    };
    for (const OnRay& s : all) range.add(Real(s.alpha), point(s));
    int looks = 0;
    const auto look = [&](const auto& points, auto& squares) {
        ++looks;
        for (int k = 0; k < MedianSearch<Real>::kPoints; ++k) {
            squares[k] = 1;
            for (const OnRay& s : splats)
                squares[k] *= squared_transmittance(
                    Real(s.alpha), (points[k] - point(s).depth) * point(s).inverse);
        }
    };
    MedianSearch<Real> search;
    const bool found = find_median(range, look, search);
    if (turns != nullptr) *turns = looks;
    return found ? search.median() : 0;
}

TEST(Median, PassedLightIsTheDefinition) {
    for (const double alpha : {0.0, 0.004, 0.5, 0.99})
        for (double x = -3.9; x < 3.95; x += 0.13) {
            const double T = light({{alpha, 2, 0.1}}, 2 + 0.1 * x);
            EXPECT_TRUE(close(squared_transmittance(alpha, x), T * T, 1e-12))
                << alpha << " at " << x;
        }
    EXPECT_EQ(squared_transmittance(0.7, -4.01), 1);
    EXPECT_NEAR(squared_transmittance(0.7, 4.01), 0.09, 1e-15);
    // The effect of the cut-off.
    EXPECT_LT(1 - squared_transmittance(0.99, -3.9999), 4e-4);
}

TEST(Median, DerivativesOfPassedLight) {
    for (const double alpha : {0.01, 0.6, 0.98})
        for (const double x : {-3.0, -0.8, -1e-3, 1e-3, 0.5, 2.5}) {
            const double s = 0.3;
            const auto log_light = [&](double a, double t, double inverse_square) {
                return 0.5 * std::log(squared_transmittance(a, t * std::sqrt(inverse_square)));
            };
            const auto by = log_transmittance_vjp(alpha, x, s, 1 / s);
            const double t = x * s, k = 1 / (s * s);
            EXPECT_TRUE(close(
                by.by_alpha,
                central_difference([&](double h) { return log_light(alpha + h, t, k); }, 1e-4),
                1e-7));
            EXPECT_TRUE(close(
                by.by_depth,
                central_difference([&](double h) { return log_light(alpha, t + h, k); }, 1e-4),
                1e-7));
            EXPECT_TRUE(close(
                by.by_square,
                central_difference([&](double h) { return log_light(alpha, t, k + h); }, 1e-3),
                1e-6, 1e-5));
            EXPECT_LT(by.by_depth, 0) << "light only ever falls";
        }
    // Beyond the cut-off only the absorbed light remains.
    const auto beyond = log_transmittance_vjp(0.6, 5.0, 0.3, 1 / 0.3),
               front = log_transmittance_vjp(0.6, -5.0, 0.3, 1 / 0.3);
    EXPECT_NEAR(beyond.by_alpha, -1 / 0.4, 1e-12);
    EXPECT_EQ(beyond.by_depth, 0);
    EXPECT_EQ(front.by_alpha, 0);
}

TEST(Median, KnownCases) {
    // One opaque splat: the median approaches its centre as the splat gets thin.
    for (const double s : {1e-2, 1e-3, 1e-4})
        EXPECT_NEAR(median_by_search<double>({{0.99, 3, s}}), 3, 1.7 * s);
    EXPECT_LT(median_by_search<double>({{0.99, 3, 1e-3}}), 3) << "half is gone before the centre";
    // Half of the light gets through: no surface.
    EXPECT_EQ(median_by_search<double>({{0.4, 3, 0.01}}), 0);
    EXPECT_EQ(median_by_search<double>({{0.3, 3, 0.01}, {0.2, 4, 0.01}}), 0);
    // Two opaque planes: the front one, in either order.
    const OnRay front{0.9, 2, 1e-3}, back{0.9, 3, 1e-3};
    EXPECT_NEAR(median_by_search<double>({front, back}), 2, 2e-3);
    EXPECT_NEAR(median_by_search<double>({front, back}), median_by_search<double>({back, front}),
                1e-7);
    // Front 0.4, back 0.9: the back one, slightly in front of it.
    for (const double s : {1e-2, 1e-3}) {
        const double t = median_by_search<double>({{0.4, 2, s}, {0.9, 3, s}});
        EXPECT_LT(t, 3);
        EXPECT_NEAR(t, 3, 3 * s);
    }
}

std::vector<OnRay> some_ray(unsigned seed, double thinnest) {
    test::Random random(seed);
    std::vector<OnRay> splats;
    const int count = static_cast<int>(random.uniform(2, 25));
    for (int i = 0; i < count; ++i) {
        // A surface between floaters, in an approximate order.
        const bool floats = random.uniform(0, 1) < 0.3;
        splats.push_back({random.uniform(0.01, floats ? 0.2 : 0.9),
                          floats ? random.uniform(0.5, 8) : 4 + 0.03 * random.normal(),
                          std::exp(random.uniform(std::log(thinnest), std::log(0.3)))});
    }
    return splats;
}

TEST(Median, SearchFindsWhatBisectionFinds) {
    int defined = 0, most = 0;
    for (unsigned seed = 0; seed < 2000; ++seed) {
        const auto splats = with_part(some_ray(seed, 1e-4));
        const double exact = median_by_bisection(splats);
        int turns = 0;
        const double found = median_by_search<double>(splats, &turns);
        const double single = static_cast<double>(median_by_search<float>(splats));
        // Close to half of all remaining light the cut-off of profiles decides.
        const double rest = light(splats, 1e3);
        if (rest > 0.499 && rest < 0.501) continue;
        ASSERT_EQ(found > 0, exact > 0) << seed;
        ASSERT_EQ(single > 0, exact > 0) << seed;
        if (exact == 0) continue;
        ++defined, most = std::max(most, turns);
        // The error as light: deviation of T at the found depth from one half. It includes the
        // cut-off of some wide profiles.
        EXPECT_NEAR(light(splats, found), 0.5, 1e-3) << seed;
        EXPECT_NEAR(light(splats, single), 0.5, 2e-3) << seed;
    }
    EXPECT_GT(defined, 1000);
    EXPECT_LE(most, 10);
}

TEST(Median, VjpAgainstDifferencesOfBisection) {
    int checked = 0;
    for (unsigned seed = 0; seed < 60; ++seed) {
        auto splats = some_ray(seed, 0.05);
        const double t = median_by_bisection(splats);
        if (t == 0) continue;
        double slope = 0;
        for (const OnRay& s : splats)
            slope += log_transmittance_vjp(s.alpha, (t - s.depth) / s.deviation, s.deviation,
                                           1 / s.deviation)
                         .by_depth;
        const double by_light = median_vjp(t, slope, 1.3);
        double all = 0;
        for (OnRay& s : splats) {
            if (std::abs(std::abs(t - s.depth) / s.deviation - 4) < 0.3) continue;  // cut-off
            const auto by = log_transmittance_vjp(s.alpha, (t - s.depth) / s.deviation, s.deviation,
                                                  1 / s.deviation);
            all -= by_light * by.by_depth;
            const auto difference = [&](double& parameter) {
                const double kept = parameter;
                const double d = central_difference(
                    [&](double h) {
                        parameter = kept + h;
                        const double v = 1.3 * median_by_bisection(splats);
                        parameter = kept;
                        return v;
                    },
                    1e-4);
                return d;
            };
            // 3e-4 of a profile lies beyond its cut-off.
            const double tolerance = 3e-3;
            EXPECT_TRUE(close(by_light * by.by_alpha, difference(s.alpha), tolerance, 1));
            EXPECT_TRUE(close(-by_light * by.by_depth, difference(s.depth), tolerance, 1));
            // 1/s^2 falls by 2 / s^3 per unit of s.
            EXPECT_TRUE(close(-2 * by_light * by.by_square / std::pow(s.deviation, 3),
                              difference(s.deviation), tolerance, 1));
            ++checked;
        }
        EXPECT_LT(all, 1.3 * 1.01) << "moved all together, the median moves along";
    }
    EXPECT_GT(checked, 200);
    EXPECT_EQ(median_vjp(3.0, 0.0, 1.0), 0) << "no derivative where no light is taken";
}

}  // namespace
}  // namespace tvsgs
