#include <vector>

#include "render/depth/normal_math.h"
#include "render/tiles/blend_math.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;

const double kHalf = std::sqrt(0.5);
const EllipseRoot<double> kUnitCircle{kHalf, 0, kHalf};

struct Splat {
    Vec2<double> mean;
    EllipseRoot<double> root;
    double opacity;
    SplatFeatures<double> features;

    SplatShape<double> shape() const { return {mean, root, opacity, splat_reach(opacity)}; }
};

std::vector<Splat> some_splats(int count, unsigned seed, double most_opacity) {
    test::Random random(seed);
    std::vector<Splat> splats;
    for (int i = 0; i < count; ++i) {
        Splat s{};
        s.mean = {random.uniform(-2, 2), random.uniform(-2, 2)};
        s.root = {random.uniform(0.2, 0.4), random.uniform(-0.1, 0.1), random.uniform(0.2, 0.4)};
        s.opacity = random.uniform(0.3, most_opacity);
        s.features = {random.normal3(), random.normal3(), random.normal()};
        splats.push_back(s);
    }
    return splats;
}

constexpr Channels kAll = Channels::color_plane;

/// The pixel at the origin; `stop` counts the splats up to the last blended one.
PixelForward<double> forward(const std::vector<Splat>& splats, std::size_t& stop) {
    PixelForward<double> pixel;
    stop = 0;
    for (std::size_t i = 0; i < splats.size(); ++i) {
        const double alpha = splat_alpha(splats[i].shape(), splats[i].mean).alpha;
        if (alpha == 0) continue;
        if (!blend<kAll>(pixel, alpha, splats[i].features)) break;
        stop = i + 1;
    }
    return pixel;
}

double value(const std::vector<Splat>& splats, const SplatFeatures<double>& w) {
    std::size_t stop;
    return feature_dot<kAll>(forward(splats, stop).sum, w);
}

std::vector<SplatGradients<double>> backward(const std::vector<Splat>& splats,
                                             const SplatFeatures<double>& w) {
    std::size_t stop;
    PixelBackward<double> pixel{forward(splats, stop).T, w};
    std::vector<SplatGradients<double>> g(splats.size());
    for (std::size_t i = stop; i-- > 0;) {
        const SplatShape<double> shape = splats[i].shape();
        blend_vjp<kAll>(pixel, shape.root, splats[i].features, whitened(shape.root, shape.mean),
                        splat_alpha(shape, shape.mean), g[i]);
        complete(g[i], shape);
    }
    // After the backward pass the transmittance is 1 again.
    EXPECT_TRUE(close(pixel.T, 1, 1e-12));
    return g;
}

const SplatFeatures<double> kWeights{{0.7, -0.3, 0.5}, {0.2, 0.9, -0.6}, 0.4};

TEST(Blend, VjpAgainstDifferences) {
    // Opacities up to 0.85: no clamp at 0.99, and eight splats leave T above the stop.
    std::vector<Splat> splats = some_splats(8, 5, 0.85);
    const auto g = backward(splats, kWeights);
    for (std::size_t i = 0; i < splats.size(); ++i) {
        Splat& s = splats[i];
        SplatFeatures<double>& f = splats[i].features;
        const auto derivative = [&](double& parameter) {
            const double kept = parameter;
            const double d = central_difference(
                [&](double t) {
                    parameter = kept + t;
                    const double v = value(splats, kWeights);
                    parameter = kept;
                    return v;
                },
                1e-4);
            return d;
        };
        const double tolerance = 1e-7;  // differences with h = 1e-4 and one Richardson step
        EXPECT_TRUE(close(g[i].mean.x, derivative(s.mean.x), tolerance));
        EXPECT_TRUE(close(g[i].mean.y, derivative(s.mean.y), tolerance));
        // The exponent is |root d|^2: by the entries of root, -2 spread root^-T.
        const EllipseRoot<double>& r = s.root;
        const Sym2<double>& W = g[i].spread;
        const double dy = 1 / r.yy, dx = 1 / r.xx, slope = -r.xy * dx * dy;  // root^-1
        EXPECT_TRUE(close(-2 * (W.xx * dx + W.xy * slope), derivative(s.root.xx), tolerance));
        EXPECT_TRUE(close(-2 * W.xy * dy, derivative(s.root.xy), tolerance));
        EXPECT_TRUE(close(-2 * W.yy * dy, derivative(s.root.yy), tolerance));
        EXPECT_TRUE(close(g[i].opacity, derivative(s.opacity), tolerance));
        for (int c = 0; c < 3; ++c) {
            EXPECT_TRUE(close(g[i].features.color[c], derivative(f.color[c]), tolerance));
            EXPECT_TRUE(close(g[i].features.normal[c], derivative(f.normal[c]), tolerance));
        }
        EXPECT_TRUE(close(g[i].features.distance, derivative(f.distance), tolerance));
        EXPECT_DOUBLE_EQ(g[i].abs_mean.x, std::abs(g[i].mean.x));  // one pixel: no cancellation
    }
}

TEST(Blend, OneOpaqueSplatAndItsClamp) {
    Splat s{};
    s.root = kUnitCircle;
    s.opacity = 0.999;
    s.features.color = {1, 0.5, 0.25};
    std::size_t stop;
    const auto pixel = forward({s}, stop);
    EXPECT_NEAR(pixel.sum.color.x, 0.99, 1e-7);  // kMaxAlpha is a float
    EXPECT_NEAR(pixel.T, 0.01, 1e-7);
    // Straight through the clamp: the gradient is that of an unclamped alpha.
    const auto g = backward({s}, {{1, 0, 0}, {}, 0});
    EXPECT_NEAR(g[0].opacity, 1, 1e-6);
    EXPECT_EQ(g[0].front_pixels, 1);
}

TEST(Blend, CutOffs) {
    Splat faint{};
    faint.root = kUnitCircle;
    faint.opacity = 0.999 / 255;  // just below one step of 8-bit colour
    EXPECT_EQ(splat_alpha(faint.shape(), {0, 0}).alpha, 0);
    faint.opacity = 1.001 / 255;
    EXPECT_GT(splat_alpha(faint.shape(), {0, 0}).alpha, 0);
    for (const EllipseRoot<double> broken :
         {EllipseRoot<double>{NAN, 0, kHalf}, {kHalf, NAN, NAN}}) {
        const SplatShape<double> s{{0, 0}, broken, 0.5, splat_reach(0.5)};
        EXPECT_EQ(splat_alpha(s, {1, 0}).alpha, 0);
        EXPECT_FALSE(may_draw(s, {1, 1}, {8, 8}));
    }

    // Two splats of alpha 0.99 leave T = 1e-4, rounded just above or below; a third is not blended
    // in any case.
    Splat wall{};
    wall.root = kUnitCircle;
    wall.opacity = 0.99;
    wall.features.color = {1, 1, 1};
    std::size_t stop;
    const auto pixel = forward({wall, wall, wall}, stop);
    EXPECT_LE(stop, 2u);
    EXPECT_GE(pixel.T, 1e-4 * (1 - 1e-6));
}

TEST(Blend, FrontCountStopsAtHalf) {
    Splat s{};
    s.root = kUnitCircle;
    s.opacity = 0.4;
    const auto g = backward({s, s, s}, kWeights);  // T in front: 1, 0.6, 0.36
    EXPECT_EQ(g[0].front_pixels, 1);
    EXPECT_EQ(g[1].front_pixels, 1);
    EXPECT_EQ(g[2].front_pixels, 0);
}

TEST(LeastExponent, AgainstAFineGrid) {
    test::Random random(6);
    for (int trial = 0; trial < 200; ++trial) {
        SplatShape<double> s{};
        s.mean = {random.uniform(-10, 26), random.uniform(-10, 26)};
        s.root = {random.uniform(0.07, 1), random.uniform(-0.6, 0.6), random.uniform(0.07, 1)};
        const Vec2<double> low{0.5, 0.5}, high{15.5, 15.5};
        double least = 1e300;
        for (int i = 0; i <= 300; ++i)
            for (int j = 0; j <= 300; ++j) {
                const auto w =
                    whitened(s.root, {0.5 + 0.05 * i - s.mean.x, 0.5 + 0.05 * j - s.mean.y});
                least = std::min(least, dot(w, w));
            }
        const double exact = least_exponent(s, low, high);
        EXPECT_LE(exact, least + 1e-12);
        // A grid of 0.05 px misses the minimum by at most lambda_max d^2 with d <= 0.036, plus
        // its slope: loose, but catches a wrong edge.
        EXPECT_GE(exact, least - 0.01 - 0.1 * std::sqrt(least));
    }
}

TEST(MayDraw, NeverCullsAPixelThatDraws) {
    // In float, as in the kernels: needles and specks, far from and near to an 8 x 8 square, with
    // opacities down to the cut-off. The test must not cull a splat that draws in the square.
    test::Random random(16);
    int drawn = 0, culled = 0;
    for (int trial = 0; trial < 200000; ++trial) {
        const double angle = random.uniform(0, 3.14159), c = std::cos(angle), s = std::sin(angle);
        const double length = std::exp(random.uniform(-1, 8)),
                     width = std::exp(random.uniform(-1, 2));
        const double v1 = length * length, v2 = std::min(width * width, v1);
        Sym2f C{float(v1 * c * c + v2 * s * s), float((v1 - v2) * c * s),
                float(v1 * s * s + v2 * c * c)};
        const float det = C.xx * C.yy - C.xy * C.xy;
        if (!(det > 0)) continue;
        SplatShape<float> shape{};
        shape.root = ellipse_root(C, det);
        shape.opacity = float(random.uniform(0, 1) < 0.5 ? 1 / (255 * random.uniform(0.5, 1))
                                                         : random.uniform(0.004, 1));
        shape.reach = splat_reach(shape.opacity);
        // Near the edge of the ellipse as seen from the square, often along the needle.
        const double along = random.uniform(-4, 4) * length, across = random.uniform(-4, 4) * width;
        const int left = int(random.uniform(0, 4000)) / 8 * 8,
                  top = int(random.uniform(0, 4000)) / 8 * 8;
        shape.mean = {float(left + 4 + along * c - across * s),
                      float(top + 4 + along * s + across * c)};
        bool draws = false;
        for (int y = 0; y < 8; ++y)
            for (int x = 0; x < 8; ++x)
                draws |= splat_alpha(shape, {shape.mean.x - (float(left + x) + 0.5f),
                                             shape.mean.y - (float(top + y) + 0.5f)})
                             .alpha > 0;
        const bool may = may_draw(shape, {float(left) + 0.5f, float(top) + 0.5f},
                                  {float(left) + 7.5f, float(top) + 7.5f});
        EXPECT_TRUE(may || !draws) << "trial " << trial;
        drawn += draws, culled += !may;
    }
    EXPECT_GT(drawn, 5000);
    EXPECT_GT(culled, 50000);
}

TEST(PlaneDepth, ValueVjpAndGuards) {
    const Vec3d n{0.1, -0.2, -0.7}, ray{0.3, 0.2, 1};
    EXPECT_DOUBLE_EQ(plane_depth(n, 1.5, ray, 0.9), 1.5 / -dot(n, ray));
    const auto g = plane_depth_vjp(n, 1.5, ray, 0.8);
    for (int c = 0; c < 3; ++c) {
        const auto f = [&](double t) {
            Vec3d moved = n;
            moved[c] += t;
            return 0.8 * plane_depth(moved, 1.5, ray, 0.9);
        };
        EXPECT_TRUE(close(g.dL_dnormal[c], central_difference(f), 1e-9));
    }
    EXPECT_TRUE(close(g.dL_ddistance, central_difference([&](double t) {
                          return 0.8 * plane_depth(n, 1.5 + t, ray, 0.9);
                      }),
                      1e-9));
    EXPECT_EQ(plane_depth(Vec3d{1, 0, 0}, 1.0, Vec3d{0.5, 0, 1}, 0.9), 0);  // faces away
    EXPECT_EQ(plane_depth(Vec3d{0, 0, -1e-9}, 1e-9, Vec3d{0, 0, 1}, 1e-9),
              0);  // almost empty pixel
    EXPECT_EQ(plane_depth(Vec3d{NAN, 0, -1}, 1.0, Vec3d{0, 0, 1}, 0.9), 0);
}

TEST(DepthNormal, FrontalWallAndVjp) {
    const auto wall =
        depth_normal(Vec3d{-1, 0, 2}, Vec3d{1, 0, 2}, Vec3d{0, -1, 2}, Vec3d{0, 1, 2});
    EXPECT_DOUBLE_EQ(wall.normal.z, -1);
    const Vec3d left{-1, 0.1, 2}, right{1, 0.2, 2.3}, up{0.1, -1, 1.9}, down{-0.1, 1.1, 2.2},
        w{0.3, -0.8, 0.5};
    const auto n = depth_normal(left, right, up, down);
    const auto g = depth_normal_vjp(n, w);
    for (int c = 0; c < 3; ++c) {
        Vec3d e{};
        e[c] = 1;
        const auto by_right = [&](double t) {
            return dot(w, depth_normal(left, right + t * e, up, down).normal);
        };
        const auto by_up = [&](double t) {
            return dot(w, depth_normal(left, right, up + t * e, down).normal);
        };
        EXPECT_TRUE(close(g.dL_da[c], central_difference(by_right), 1e-8));
        EXPECT_TRUE(close(g.dL_db[c], central_difference(by_up), 1e-8));
    }
    const auto none = depth_normal_vjp(depth_normal(left, left, up, down), w);
    EXPECT_EQ(none.dL_da.x, 0);
}

}  // namespace
}  // namespace tvsgs
