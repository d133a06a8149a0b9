// Tests surfels in double: closed-form intersections, and all derivatives against central
// differences.
#include <gtest/gtest.h>

#include "render/surfel/surfel_math.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;

Camera test_view() {
    Camera c;
    c.width_px = 640, c.height_px = 480;
    c.fx_px = 500, c.fy_px = 520, c.cx_px = 310, c.cy_px = 250;
    return c;
}

/// A tilted surfel about `depth` away with different scales.
SurfelAxes<double> random_axes(test::Random& random, double depth, double size) {
    const Mat3<double> R =
        rotation(normalize(Quat<double>{random.uniform(-1, 1), random.uniform(-1, 1),
                                        random.uniform(-1, 1), random.uniform(-1, 1)}));
    const double s = size * random.uniform(0.5, 2), t = size * random.uniform(0.5, 2);
    return {s * column(R, 0), t * column(R, 1),
            depth * Vec3d{random.uniform(-0.4, 0.4), random.uniform(-0.3, 0.3), 1}};
}

TEST(SurfelMath, RaysMeetThePlaneWhereTheyDo) {
    test::Random random(1);
    const auto camera = pinhole<double>(test_view());
    int met = 0;
    for (int trial = 0; trial < 400; ++trial) {
        const SurfelAxes<double> axes = random_axes(random, 3, 0.05);
        SurfelShape<double> s;
        if (!surfel_shape(camera, axes, 0.9, s)) continue;
        const Vec2<double> d{random.uniform(-10, 10), random.uniform(-10, 10)};
        const SurfelHit<double> hit = surfel_hit(s, d);
        const Vec3d ray{(s.mean.x + d.x - camera.cx) / camera.fx,
                        (s.mean.y + d.y - camera.cy) / camera.fy, 1};
        const Vec3d n = cross(axes.a, axes.b);
        const double z = dot(n, axes.centre) / dot(n, ray);
        const Vec3d on_plane = z * ray - axes.centre;
        const double u = dot(on_plane, axes.a) / dot(axes.a, axes.a),
                     v = dot(on_plane, axes.b) / dot(axes.b, axes.b);
        const Vec2<double> from_dot = d - s.low_pass;
        const double rho = std::min(u * u + v * v, 2 * dot(from_dot, from_dot));
        const double alpha = 0.9 * std::exp(-rho / 2);
        if (std::abs(alpha - 1.0 / 255) < 1e-9) continue;
        ASSERT_EQ(hit.alpha > 0,
                  z > axes.centre.z / 20 && z < axes.centre.z * 20 && alpha >= 1.0 / 255);
        if (hit.alpha == 0) continue;
        ++met;
        EXPECT_NEAR(hit.alpha, alpha, 1e-9);
        EXPECT_NEAR(hit.z, z, 1e-9);
        EXPECT_NEAR(hit.uv.x, u, 1e-7);
        EXPECT_NEAR(hit.uv.y, v, 1e-7);
    }
    EXPECT_GT(met, 100);
}

/// Seen straight on, the outline is a circle that touches the box.
TEST(SurfelMath, BoxesAreTight) {
    const auto camera = pinhole<double>(test_view());
    SurfelShape<double> s;
    ASSERT_TRUE(surfel_shape(camera, {{0.1, 0, 0}, {0, 0.2, 0}, {0, 0, 2}}, 0.5, s));
    const double reach = std::sqrt(2 * std::log(0.5 / double(kLeastSurfelAlpha)));
    EXPECT_NEAR(s.high.x, reach * 0.1 * 500 / 2, 1e-9);
    EXPECT_NEAR(s.low.y, -reach * 0.2 * 520 / 2, 1e-9);
    EXPECT_NEAR(norm(Vec3d{s.low_pass.x, s.low_pass.y, 0}), 0, 1e-12);

    // Tilted: no pixel outside the box draws, and some on its edges almost do.
    test::Random random(2);
    for (int trial = 0; trial < 100; ++trial) {
        const double opacity = random.uniform(0.05, 0.99);
        if (!surfel_shape(camera, random_axes(random, 3, 0.1), opacity, s)) continue;
        const double width = s.high.x - s.low.x, height = s.high.y - s.low.y;
        double nearest = 1e9;
        for (int i = -20; i <= 420; ++i)
            for (int j = -20; j <= 420; ++j) {
                const Vec2<double> d{s.low.x + width * i / 400, s.low.y + height * j / 400};
                if (surfel_hit(s, d).alpha == 0) continue;
                ASSERT_TRUE(i >= 0 && i <= 400 && j >= 0 && j <= 400) << trial;
                nearest = std::min({nearest, d.x - s.low.x, s.high.x - d.x, d.y - s.low.y});
            }
        EXPECT_LT(nearest, 0.02 * std::max(width, height)) << trial;
    }
}

/// A disc that reaches the camera's plane has no box.
TEST(SurfelMath, UnboundedDiscsAreNotDrawn) {
    const auto camera = pinhole<double>(test_view());
    SurfelShape<double> s;
    EXPECT_FALSE(surfel_shape(camera, {{0, 0.1, 1}, {0.1, 0, 0}, {0.1, 0, 2}}, 0.9, s));
    EXPECT_TRUE(surfel_shape(camera, {{0, 0.1, 0.5}, {0.1, 0, 0}, {0.1, 0, 2}}, 0.9, s));
}

TEST(SurfelMath, DiscsOnEdgeAreNotDrawn) {
    const auto camera = pinhole<double>(test_view());
    SurfelShape<double> s;
    EXPECT_FALSE(surfel_shape(camera, {{0, 0, 0.5}, {0.1, 0, 0}, {0.1, 0, 2}}, 0.9, s));
    EXPECT_TRUE(surfel_shape(camera, {{0, 1e-5, 0.5}, {0.1, 0, 0}, {0.1, 0, 2}}, 0.9, s));
}

/// A splat of a thousandth of a pixel keeps its precision in float far from the image's corner.
TEST(SurfelMath, SmallSplatsFarOffAxisInFloat) {
    test::Random random(3);
    const auto exact = pinhole<double>(test_view());
    const auto camera = pinhole<float>(test_view());
    double worst = 0;
    for (int trial = 0; trial < 200; ++trial) {
        const SurfelAxes<double> axes = random_axes(random, 50, 0.05);
        SurfelShape<double> s;
        SurfelShape<float> f;
        if (!surfel_shape(exact, axes, 0.9, s)) continue;
        const SurfelAxes<float> rounded{vec_cast<float>(axes.a), vec_cast<float>(axes.b),
                                        vec_cast<float>(axes.centre)};
        ASSERT_TRUE(surfel_shape(camera, rounded, 0.9f, f));
        const Vec2<double> d{random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5)};
        const auto a = surfel_hit(s, d);
        const auto b = surfel_hit(f, {static_cast<float>(d.x), static_cast<float>(d.y)});
        if (a.alpha < 0.01) continue;
        worst = std::max(worst, std::abs(a.alpha - static_cast<double>(b.alpha)));
    }
    EXPECT_LT(worst, 2e-4);
}

/// A pixel through several surfels, as a function of all parameters.
struct Stack {
    std::vector<SurfelAxes<double>> axes;
    std::vector<double> opacities;
    std::vector<SurfelFeatures<double>> features;
    Vec2<double> pixel;
    SurfelPixelGradient<double> by;  // of color, normal, coverage, z, median, distortion
};

std::vector<SurfelShape<double>> shapes_of(const Stack& stack) {
    const auto camera = pinhole<double>(test_view());
    std::vector<SurfelShape<double>> shapes(stack.axes.size());
    for (std::size_t i = 0; i < shapes.size(); ++i)
        EXPECT_TRUE(surfel_shape(camera, stack.axes[i], stack.opacities[i], shapes[i]));
    return shapes;
}

/// The pixel near `at`. The depth of a splat drawn as a dot changes only with its centre, as in the
/// derivatives.
SurfelPixel<double> blended(const Stack& stack, const Stack& at) {
    const auto shapes = shapes_of(stack), fixed = shapes_of(at);
    SurfelPixel<double> pixel;
    for (std::size_t i = 0; i < shapes.size(); ++i) {
        auto hit = surfel_hit(shapes[i], stack.pixel - shapes[i].mean);
        if (hit.low_pass) {
            const double moved = stack.axes[i].centre.z - at.axes[i].centre.z;
            hit.z = surfel_hit(fixed[i], stack.pixel - fixed[i].mean).z + moved;
            hit.inverse = 1 / hit.z;
        }
        blend<true>(pixel, hit, stack.features[i]);
    }
    return pixel;
}

double value_of(const Stack& stack, const SurfelPixel<double>& p) {
    return dot(stack.by.color, p.color) + dot(stack.by.normal, p.normal) +
           stack.by.coverage * (1 - p.T) + stack.by.z * p.z + stack.by.median * p.median +
           stack.by.distortion * p.distortion;
}

Stack random_stack(test::Random& random, bool small) {
    Stack stack;
    stack.pixel = {330.5, 241.5};
    for (int i = 0; i < 5; ++i) {
        SurfelAxes<double> axes = random_axes(random, 2 + 0.3 * i, small ? 1e-3 : 0.05);
        const double x = random.uniform(-0.3, 0.3), y = random.uniform(-0.3, 0.3);  // px
        axes.centre = axes.centre.z *
                      Vec3d{(stack.pixel.x + x - 310) / 500, (stack.pixel.y + y - 250) / 520, 1};
        stack.axes.push_back(axes);
        stack.opacities.push_back(random.uniform(0.1, 0.6));
        stack.features.push_back({random.normal3(), random.normal3()});
    }
    stack.by.color = random.normal3(), stack.by.normal = random.normal3();
    stack.by.coverage = random.uniform(-1, 1), stack.by.z = random.uniform(-1, 1);
    stack.by.median = random.uniform(-1, 1), stack.by.distortion = random.uniform(-9, 9);
    return stack;
}

class SurfelDerivatives : public testing::TestWithParam<bool> {};

TEST_P(SurfelDerivatives, AreThoseOfThePixel) {
    test::Random random(GetParam() ? 5 : 4);
    const auto camera = pinhole<double>(test_view());
    int dots = 0, planes = 0;
    for (int trial = 0; trial < 40; ++trial) {
        Stack stack = random_stack(random, GetParam());
        const auto shapes = shapes_of(stack);
        std::vector<SurfelHit<double>> hits;
        bool unusual = false;  // at a jump of the formulas, where differences are not valid
        for (const auto& s : shapes) {
            hits.push_back(surfel_hit(s, stack.pixel - s.mean));
            const auto& h = hits.back();
            const Vec2<double> from_dot = h.offset - s.low_pass;
            unusual |=
                h.alpha < 0.01 || std::abs(dot(h.uv, h.uv) - 2 * dot(from_dot, from_dot)) < 1e-3;
            (h.low_pass ? dots : planes) += 1;
        }
        const Stack fixed = stack;
        const SurfelPixel<double> pixel = blended(stack, fixed);
        double T = 1;
        for (const auto& h : hits) unusual |= std::abs(T - 0.5) < 1e-3, T *= 1 - h.alpha;
        if (unusual) continue;

        SurfelPixelGradient<double> by = stack.by;
        by.all = 1 - pixel.T, by.first = pixel.first, by.second = pixel.second;
        SurfelPixelBackward<double> back{pixel.T, by}, parted = back;
        for (std::size_t i = shapes.size(); i-- > 0;) {
            SurfelGradients<true, double> g{}, half{};
            blend_vjp<true>(back, shapes[i], stack.features[i], hits[i], g);
            blend_vjp<true, true>(parted, shapes[i], stack.features[i], hits[i], half, 0.5);
            SurfelMatrixGradient<double> matrix = surfel_inverse_vjp(shapes[i], g.inverse);
            matrix.row_z.z += g.depth;
            low_pass_vjp(surfel_rows(camera, stack.axes[i]), shapes[i].low_pass, g.inverse.low_pass,
                         matrix);
            const SurfelAxes<double> by_axes =
                surfel_axes_vjp(camera, stack.axes[i].centre, matrix);
            const auto slope = [&](double& x) {
                const double kept = x;
                const double d = central_difference(
                    [&](double h) {
                        x = kept + h;
                        return value_of(stack, blended(stack, fixed));
                    },
                    1e-7);
                x = kept;
                return d;
            };
            const auto expect = [&](double got, double wanted, const char* what) {
                EXPECT_TRUE(close(got, wanted, 2e-5, 1e-2))
                    << what << " of splat " << i << " in trial " << trial << ": " << got << ", "
                    << wanted << (hits[i].low_pass ? " (dot)" : "");
            };
            for (int c = 0; c < 3; ++c) {
                expect(by_axes.a[c], slope(stack.axes[i].a[c]), "first axis");
                expect(by_axes.b[c], slope(stack.axes[i].b[c]), "second axis");
                expect(by_axes.centre[c], slope(stack.axes[i].centre[c]), "centre");
                expect(g.color[c], slope(stack.features[i].color[c]), "colour");
                expect(g.normal[c], slope(stack.features[i].normal[c]), "normal");
            }
            expect(g.opacity, slope(stack.opacities[i]), "opacity");
            expect(half.opacity, g.opacity, "opacity, colours parted");
            // The derivative of half of the colours' part of the value and all of the rest.
            const Vec3d color = stack.by.color;
            stack.by.color = 0.5 * color;
            SurfelMatrixGradient<double> by_half = surfel_inverse_vjp(shapes[i], half.inverse);
            by_half.row_z.z += half.depth;
            low_pass_vjp(surfel_rows(camera, stack.axes[i]), shapes[i].low_pass,
                         half.inverse.low_pass, by_half);
            const SurfelAxes<double> half_axes =
                surfel_axes_vjp(camera, stack.axes[i].centre, by_half);
            for (int c = 0; c < 3; ++c) {
                expect(half_axes.a[c], slope(stack.axes[i].a[c]), "first axis, colours parted");
                expect(half_axes.centre[c], slope(stack.axes[i].centre[c]),
                       "centre, colours parted");
            }
            stack.by.color = color;
        }
    }
    if (GetParam())
        EXPECT_GT(dots, 50);
    else
        EXPECT_GT(planes, 50);
}

INSTANTIATE_TEST_SUITE_P(Sizes, SurfelDerivatives, testing::Bool());

/// Compares the recursion with the sum over pairs, and the median with its definition.
TEST(SurfelMath, DistortionAndMedianByTheirDefinitions) {
    test::Random random(6);
    for (int trial = 0; trial < 50; ++trial) {
        SurfelPixel<double> pixel;
        std::vector<double> w, m;
        double T = 1, median = 0;
        for (int i = 0; i < 12; ++i) {
            SurfelHit<double> hit;
            hit.alpha = random.uniform(0.01, 0.7), hit.z = random.uniform(0.5, 20),
            hit.inverse = 1 / hit.z;
            if (T * (1 - hit.alpha) < 1e-4) break;
            if (T > 0.5) median = hit.z;
            w.push_back(hit.alpha * T);
            m.push_back(100 / 99.8 * (1 - 0.2 / hit.z));
            T *= 1 - hit.alpha;
            ASSERT_TRUE(blend<true>(pixel, hit, {}));
        }
        double sum = 0;
        for (std::size_t i = 0; i < w.size(); ++i)
            for (std::size_t j = 0; j < i; ++j) sum += w[i] * w[j] * (m[i] - m[j]) * (m[i] - m[j]);
        EXPECT_NEAR(pixel.distortion, sum, 1e-12);
        EXPECT_EQ(pixel.median, median);
    }
}

}  // namespace
}  // namespace tvsgs
