// Tests planes of Gaussians in double: against their definition, and all derivatives against
// central differences.
#include <gtest/gtest.h>

#include <vector>

#include "core/math/smoothing_filter.h"
#include "render/rade/blend_rade.h"
#include "render/rade/rade_math.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;

Pinhole<double> test_pinhole() {
    Camera c;
    c.width_px = 640, c.height_px = 480;
    c.fx_px = 500, c.fy_px = 520, c.cx_px = 310, c.cy_px = 250;
    return pinhole<double>(c);
}

struct Splat {
    RadeAxes<double> axes;
    Vec3d p;
};

/// `flatness`: of one scale against the others; `off`: of the centre from the axis, in depths.
Splat random_splat(test::Random& random, double flatness, Vec2<double> off) {
    Splat s;
    s.axes.axes = rotation(normalize(random.quat()));
    for (int k = 0; k < 3; ++k) s.axes.scales[k] = 0.05 * random.uniform(0.5, 2);
    s.axes.scales[2] *= flatness;
    const double z = random.uniform(1, 4);
    s.p = {z * off.x, z * off.y, z};
    return s;
}
Splat random_splat(test::Random& random, double flatness) {
    return random_splat(random, flatness, {random.uniform(-0.5, 0.5), random.uniform(-0.4, 0.4)});
}

Mat3<double> covariance_of(const RadeAxes<double>& a) {
    Mat3<double> sum{};
    for (int k = 0; k < 3; ++k) {
        const Vec3d e = a.scales[k] * column(a.axes, k);
        for (int r = 0; r < 3; ++r)
            for (int c = 0; c < 3; ++c) sum[r][c] += e[r] * e[c];
    }
    return sum;
}

/// A x = b by Cramer's rule.
Vec3d solve(const Mat3<double>& A, Vec3d b) {
    const Vec3d x = column(A, 0), y = column(A, 1), z = column(A, 2);
    const double det = dot(x, cross(y, z));
    return {dot(b, cross(y, z)) / det, dot(x, cross(b, z)) / det, dot(x, cross(y, b)) / det};
}

/// Pixel and distance of a point, linearised at p; rows are gradients.
Mat3<double> ray_space_jacobian(const Pinhole<double>& camera, Vec3d p) {
    const auto at = [&](Vec3d x) {
        const Vec2<double> c = project_point(camera, x);
        return Vec3d{c.x, c.y, norm(x)};
    };
    Mat3<double> J;
    for (int c = 0; c < 3; ++c) {
        Vec3d step{};
        step[c] = 1e-5;
        const Vec3d slope = (at(p + step) - at(p - step)) / 2e-5;
        for (int r = 0; r < 3; ++r) J[r][c] = slope[r];
    }
    return J;
}

/// The peak of the linearised Gaussian along the ray of a pixel is the mean of a Gaussian of three
/// variables, given two of them.
TEST(RadeMath, ThePlaneIsWhereTheDensityPeaksAlongRays) {
    test::Random random(1);
    const auto camera = test_pinhole();
    for (const double flatness : {1.0, 0.3, 0.01})
        for (int trial = 0; trial < 50; ++trial) {
            const Splat s = random_splat(random, flatness);
            const auto plane = rade_plane(camera, s.axes, s.p);
            EXPECT_NEAR(plane.distance, norm(s.p), 1e-12);
            const Mat3<double> J = ray_space_jacobian(camera, s.p);
            const Mat3<double> S = J * covariance_of(s.axes) * transpose(J);
            const double det = S[0][0] * S[1][1] - S[0][1] * S[0][1];
            const Vec2<double> slope{-(S[2][0] * S[1][1] - S[2][1] * S[0][1]) / det,
                                     -(S[2][1] * S[0][0] - S[2][0] * S[0][1]) / det};
            EXPECT_TRUE(close(plane.slope.x, slope.x, 1e-5, 1e-5));
            EXPECT_TRUE(close(plane.slope.y, slope.y, 1e-5, 1e-5));
            // Two directions in the plane, and the side of the camera.
            EXPECT_NEAR(norm(plane.normal), 1, 1e-12);
            EXPECT_LT(dot(plane.normal, s.p), 0);
            for (const Vec3d along : {Vec3d{1, 0, -slope.x}, Vec3d{0, 1, -slope.y}})
                EXPECT_NEAR(dot(plane.normal, normalize(solve(J, along))), 0, 2e-5);
        }
}

TEST(RadeMath, NormalIsThatOfThePrecision) {
    test::Random random(2);
    const auto camera = test_pinhole();
    for (int trial = 0; trial < 50; ++trial) {
        Splat s = random_splat(random, 0.2);
        const auto plane = rade_plane(camera, s.axes, s.p);
        const Vec3d expected = -normalize(solve(covariance_of(s.axes), s.p));
        EXPECT_NEAR(norm(plane.normal - expected), 0, 1e-10);
        s.axes.scales = 37 * s.axes.scales;
        const auto scaled = rade_plane(camera, s.axes, s.p);
        EXPECT_NEAR(norm(scaled.normal - plane.normal), 0, 1e-12);
        EXPECT_NEAR(scaled.slope.x, plane.slope.x, 1e-12);
        EXPECT_NEAR(scaled.slope.y, plane.slope.y, 1e-12);
    }
}

TEST(RadeMath, RoundSplatsFaceTheCameraAndDoNotSlope) {
    test::Random random(3);
    const auto camera = test_pinhole();
    for (const Vec2<double> off : {Vec2<double>{0, 0}, Vec2<double>{0.3, -0.2}}) {
        Splat s = random_splat(random, 1, off);
        s.axes.scales = {0.1, 0.1, 0.1};
        const auto plane = rade_plane(camera, s.axes, s.p);
        EXPECT_NEAR(norm(plane.normal + normalize(s.p)), 0, 1e-12);
        EXPECT_NEAR(plane.slope.x, 0, 1e-15);
        EXPECT_NEAR(plane.slope.y, 0, 1e-15);
    }
}

/// The limit is the plane of the disc and does not depend on its thickness.
TEST(RadeMath, FlatSplatsHaveTheirOwnPlane) {
    test::Random random(4);
    const auto camera = test_pinhole();
    for (int trial = 0; trial < 50; ++trial) {
        Splat s = random_splat(random, 1e-6);
        const Vec3d n = column(s.axes.axes, 2);
        if (std::abs(dot(n, normalize(s.p))) < 0.1) continue;
        const auto plane = rade_plane(camera, s.axes, s.p);
        EXPECT_NEAR(std::abs(dot(plane.normal, n)), 1, 1e-10);
        // Neighbouring rays meet it at that distance.
        const Vec2<double> c = project_point(camera, s.p);
        const double d = 1e-3;
        const Vec3d ray{(c.x - d - camera.cx) / camera.fx, (c.y - camera.cy) / camera.fy, 1};
        const double met = norm(ray) * dot(n, s.p) / dot(n, ray);
        EXPECT_NEAR(plane.distance + plane.slope.x * d, met, 1e-3 * std::abs(plane.slope.x) * d);
    }
}

/// Derivatives in a direction in which every parameter moves.
void expect_derivatives(test::Random& random, const Splat& s, double tolerance) {
    const auto camera = test_pinhole();
    const RadePlane<double> by{
        random.normal3(), {100 * random.normal(), 100 * random.normal()}, random.normal()};
    const auto value = [&](const Splat& at) {
        const auto plane = rade_plane(camera, at.axes, at.p);
        return dot(by.normal, plane.normal) + dot(by.slope, plane.slope) +
               by.distance * plane.distance;
    };
    const auto g = rade_plane_vjp(camera, s.axes, s.p, by);
    const double h = 1e-4;
    for (int k = 0; k < 3; ++k) {
        const auto center = [&](double t) {
            Splat moved = s;
            moved.p[k] += t;
            return value(moved);
        };
        EXPECT_TRUE(close(g.dL_dp[k], central_difference(center, h), tolerance, 1e-2)) << k;
        const auto scale = [&](double t) {
            Splat moved = s;
            moved.axes.scales[k] *= std::exp(t);
            return value(moved);
        };
        EXPECT_TRUE(close(g.dL_dlog_scales[k], central_difference(scale, h), tolerance, 1e-2)) << k;
        // Axes need not stay a rotation: the formula holds for any three vectors.
        for (int r = 0; r < 3; ++r) {
            const auto axis = [&](double t) {
                Splat moved = s;
                moved.axes.axes[r][k] += t;
                return value(moved);
            };
            EXPECT_TRUE(close(g.dL_daxes[r][k], central_difference(axis, h), tolerance, 1e-2))
                << r << k;
        }
    }
}

TEST(RadeMath, Derivatives) {
    test::Random random(5);
    for (int trial = 0; trial < 20; ++trial) {
        expect_derivatives(random, random_splat(random, 0.5), 1e-6);
        expect_derivatives(random, random_splat(random, 0.1), 1e-5);
    }
}

TEST(RadeMath, DerivativesWhereTheCentreIsClamped) {
    test::Random random(6);
    const auto camera = test_pinhole();
    for (const Vec2<double> off : {Vec2<double>{1.2, 0.1}, Vec2<double>{-1.1, 0.1},
                                   Vec2<double>{0.1, 0.9}, Vec2<double>{1.2, -0.9}}) {
        ASSERT_TRUE(off.x > camera.u_max || off.x < camera.u_min || off.y > camera.v_max ||
                    off.y < camera.v_min);
        for (int trial = 0; trial < 10; ++trial)
            expect_derivatives(random, random_splat(random, 0.4, off), 1e-6);
    }
}

/// Edge on beyond all digits there is no plane: no normal, no slope, and no derivative except the
/// distance's.
TEST(RadeMath, EdgeOnAndBrokenSplatsHaveNoPlane) {
    const auto camera = test_pinhole();
    Splat edge{{{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, {1e-12, 1, 1}}, {1e-12, 0, 2}};
    Splat broken = edge;
    broken.axes.scales = {0, 0, 0};
    for (const Splat& s : {edge, broken}) {
        const auto plane = rade_plane(camera, s.axes, s.p);
        EXPECT_EQ(norm(plane.normal), 0);
        EXPECT_EQ(dot(plane.slope, plane.slope), 0);
        EXPECT_EQ(plane.distance, norm(s.p));
        const auto g = rade_plane_vjp(camera, s.axes, s.p, {{1, 2, 3}, {4, 5}, 6});
        EXPECT_EQ(norm(g.dL_dlog_scales), 0);
        EXPECT_NEAR(norm(g.dL_dp - 6 * normalize(s.p)), 0, 1e-12);
        for (int k = 0; k < 3; ++k) EXPECT_EQ(norm(column(g.dL_daxes, k)), 0);
    }
}

TEST(SmoothingFilter, IsARootOfAFifthOfAPixel) {
    const auto camera = test_pinhole();
    const double z = 3, f = filter_of(z, 500.0);
    EXPECT_NEAR(f, std::sqrt(0.2) * 3 / 500, 1e-12);
    EXPECT_NEAR(f * camera.fx / z, 0.4472, 1e-4) << "px";
}

/// Within 15 % of the image's size around the image, in front of the near plane.
TEST(SmoothingFilter, CountsViewsThatHaveTheSplat) {
    const auto camera = test_pinhole();
    const auto depth = [&](double x_px, double y_px, double z) {
        return depth_in_view(
            camera, 0.2,
            Vec3d{(x_px - camera.cx) / camera.fx * z, (y_px - camera.cy) / camera.fy * z, z});
    };
    EXPECT_EQ(depth(320, 240, 2), 2);
    EXPECT_EQ(depth(-95.9, 240, 2), 2);
    EXPECT_EQ(depth(-96.1, 240, 2), 0);
    EXPECT_EQ(depth(735.9, 551.9, 2), 2);
    EXPECT_EQ(depth(736.1, 240, 2), 0);
    EXPECT_EQ(depth(320, 552.1, 2), 0);
    EXPECT_EQ(depth(320, -72.1, 2), 0);
    EXPECT_EQ(depth(320, 240, 0.2), 0);
    EXPECT_EQ(depth(320, 240, -2), 0);
}

TEST(SmoothingFilter, WidensAndDims) {
    const Vec3d log_scale{std::log(3.0), 0, std::log(1e-6)};
    const auto s = smoothed(log_scale, 4.0);
    EXPECT_NEAR(s.scales.x, 5, 1e-12);
    EXPECT_NEAR(s.scales.y, std::sqrt(17.0), 1e-12);
    EXPECT_NEAR(s.dimming, 0.6 / std::sqrt(17.0) * 1e-6 / 4, 1e-15);
    const auto none = smoothed(log_scale, 0.0);
    EXPECT_EQ(none.dimming, 1);
    EXPECT_EQ(none.scales.z, std::exp(log_scale.z));
    // In float, where squares of such scales are 0.
    const auto thin = smoothed(Vec3f{-60, -60, -60}, 0.0f);
    EXPECT_EQ(thin.dimming, 1);
}

TEST(SmoothingFilter, Derivatives) {
    test::Random random(7);
    for (int trial = 0; trial < 20; ++trial) {
        const Vec3d log_scale = random.normal3(), by = random.normal3();
        const double filter = random.uniform(0.1, 2), o = random.uniform(0.1, 0.9),
                     by_opacity = random.normal();
        const auto s = smoothed(log_scale, filter);
        const Vec3d g = smoothed_vjp(s, o * s.dimming, by, by_opacity);
        for (int k = 0; k < 3; ++k) {
            const auto value = [&](double t) {
                Vec3d moved = log_scale;
                moved[k] += t;
                const auto at = smoothed(moved, filter);
                double sum = by_opacity * o * at.dimming;
                for (int c = 0; c < 3; ++c) sum += by[c] * std::log(at.scales[c]);
                return sum;
            };
            EXPECT_TRUE(close(g[k], central_difference(value), 1e-7));
        }
    }
}

/// A front splat with alpha 0.4 and a back splat with 0.9: the back one is the last that more than
/// half of the light reaches.
TEST(RadeMath, TwoPlanesHaveTheMedianOfTheBackOneAndAMeanBetween) {
    RadePixel<double> pixel;
    const SplatFeatures<double> front{{}, {0, 0, -1}, 2}, back{{}, {0, 0, -1}, 5};
    ASSERT_TRUE(blend(pixel, 0.4, {0, 0}, front, {0, 0}));
    EXPECT_EQ(pixel.median, 2);
    ASSERT_TRUE(blend(pixel, 0.9, {3, -1}, back, {0.1, 0.2}));
    EXPECT_NEAR(pixel.median, 5.1, 1e-12) << "at the pixel, not at the centre";
    const auto depths = rade_depths(pixel, 1.5);
    EXPECT_NEAR(depths.median, 5.1 / 1.5, 1e-12);
    EXPECT_NEAR(depths.expected, (0.4 * 2 + 0.54 * 5.1) / 0.94 / 1.5, 1e-12);
    ASSERT_TRUE(blend(pixel, 0.5, {0, 0}, {{}, {}, 9}, {0, 0}));
    EXPECT_NEAR(pixel.median, 5.1, 1e-12) << "less than half of the light gets there";
}

/// Splats at one pixel, and a weighted sum of their blended values: colours, normals, mean and
/// median distance.
struct PixelCase {
    struct Layer {
        Vec2<double> mean, slope;
        EllipseRoot<double> root;
        double opacity;
        SplatFeatures<double> f;
    };
    std::vector<Layer> layers;
    SplatFeatures<double> by;  // `distance`: of the mean
    double by_median;

    RadePixel<double> blended() const {
        RadePixel<double> pixel;
        for (const Layer& l : layers)
            blend(pixel, alpha(l).alpha, l.mean, l.f, l.slope);  // the pixel is at the origin
        return pixel;
    }
    double value() const {
        const RadePixel<double> p = blended();
        return dot(by.color, p.sum.color) + dot(by.normal, p.sum.normal) +
               by.distance * p.sum.distance / (1 - p.T) + by_median * p.median;
    }
    static SplatAlpha<double> alpha(const Layer& l) {
        return splat_alpha(SplatShape<double>{l.mean, l.root, l.opacity, 10}, l.mean);
    }
    /// One for each layer, completed as in the backbone.
    std::vector<RadeGradients<double>> gradients() const {
        const RadePixel<double> p = blended();
        RadePixelBackward<double> back{p.T, {by, p.sum.distance / (1 - p.T), by_median}};
        back.by.by.distance /= 1 - p.T;
        std::vector<RadeGradients<double>> out(layers.size());
        for (std::size_t i = layers.size(); i-- > 0;) {
            const Layer& l = layers[i];
            blend_vjp(back, l.root, l.mean, whitened(l.root, l.mean), alpha(l), l.f, l.slope,
                      out[i]);
            complete(out[i].of, SplatShape<double>{l.mean, l.root, l.opacity, 10});
            out[i].of.mean += out[i].of.features.distance * l.slope;
        }
        return out;
    }
};

TEST(RadeMath, DerivativesOfABlendedPixel) {
    test::Random random(8);
    const auto pair = [&](double size) {
        return Vec2<double>{random.uniform(-size, size), random.uniform(-size, size)};
    };
    for (int trial = 0; trial < 20; ++trial) {
        PixelCase c;
        c.by = {random.normal3(), random.normal3(), random.normal()};
        c.by_median = random.normal();
        for (int i = 0; i < 5; ++i)
            c.layers.push_back(
                {pair(1),
                 pair(0.5),
                 {random.uniform(0.3, 0.8), random.uniform(-0.3, 0.3), random.uniform(0.3, 0.8)},
                 random.uniform(0.2, 0.9),
                 {random.normal3(), random.normal3(), random.uniform(1, 3)}});
        const auto g = c.gradients();
        // A median that moves to another splat within the step has no derivative.
        double T = 1;
        bool near_half = false;
        for (const auto& l : c.layers)
            T *= 1 - PixelCase::alpha(l).alpha, near_half = near_half || std::abs(T - 0.5) < 0.01;
        if (near_half) continue;
        for (std::size_t i = 0; i < c.layers.size(); ++i) {
            const auto check = [&](double analytic, double& parameter, const char* what) {
                const double kept = parameter;
                const double expected = central_difference(
                    [&](double t) {
                        parameter = kept + t;
                        return c.value();
                    },
                    1e-4);
                parameter = kept;
                EXPECT_TRUE(close(analytic, expected, 1e-6)) << what << ' ' << i << ' ' << trial;
            };
            auto& l = c.layers[i];
            check(g[i].of.features.distance, l.f.distance, "distance");
            check(g[i].slope.x, l.slope.x, "slope");
            check(g[i].slope.y, l.slope.y, "slope");
            check(g[i].of.mean.x, l.mean.x, "mean");
            check(g[i].of.mean.y, l.mean.y, "mean");
            check(g[i].of.opacity, l.opacity, "opacity");
            check(g[i].of.features.color.y, l.f.color.y, "colour");
            check(g[i].of.features.normal.z, l.f.normal.z, "normal");
        }
    }
}

TEST(RadeMath, PixelsOutOfReachAddZeros) {
    RadePixel<float> pixel;
    const SplatFeatures<float> f{{1, 1, 1}, {0, 0, -1}, 2};
    EXPECT_TRUE(blend(pixel, 0.0f, {0, kOutOfReach}, f, {0, 1e20f}));
    EXPECT_EQ(pixel.sum.distance, 0);
    EXPECT_EQ(pixel.T, 1);
    RadePixelBackward<float> back{0.5f, {{{1, 1, 1}, {1, 1, 1}, 1}, 1, 1}};
    RadeGradients<float> g{};
    blend_vjp(back, {1, 0, 1}, Vec2f{0, kOutOfReach}, Vec2f{0, kOutOfReach},
              SplatAlpha<float>{0, 0}, f, Vec2f{0, 1e20f}, g);
    EXPECT_EQ(g.of.features.distance, 0);
    EXPECT_EQ(g.slope.y, 0);
    EXPECT_EQ(g.of.mean.y, 0);
    EXPECT_FALSE(back.had_median);
    EXPECT_EQ(back.T, 0.5f);
}

}  // namespace
}  // namespace tvsgs
