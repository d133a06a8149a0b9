// Tests dL/d of a camera: each rasteriser against differences of a brute-force renderer in double,
// and the devices against each other.

#include <algorithm>
#include <cstring>
#include <functional>

#include "core/device/threads.h"
#include "render/backbone.h"
#include "render/ewa/projection_math.h"
#include "render/surfel/surfel_math.h"
#include "render/tiles/blend_math.h"
#include "render/tiles/camera_math.h"
#include "render/tiles/sh_math.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using test::close;
using test::random_gaussians;
using test::test_camera;

constexpr int kSide = 32;

Vec3d weight_of(std::size_t p) {
    const double t = static_cast<double>(p);
    return {std::sin(t), std::cos(2 * t), std::sin(3 * t + 1)};
}
/// Weights of the transmittance.
double coverage_weight(std::size_t p) {
    return std::cos(0.7 * static_cast<double>(p));
}

/// A camera in double, for steps of 1e-6 that float could not represent.
struct MovedCamera {
    Pinhole<double> pinhole;
    Vec3d centre;

    MovedCamera(const Camera& c, int number, double by) : pinhole(tvsgs::pinhole<double>(c)) {
        Vec3d turn, shift;
        if (number < 3) turn[number] = by;
        if (number >= 3) shift[number - 3] = by;
        pinhole.camera_from_world = rigid_exp(turn, shift) * pinhole.camera_from_world;
        centre = inverse(pinhole.camera_from_world).t;
    }
};

/// A splat of any rasteriser at a pixel.
struct DrawnSplat {
    double depth;
    Vec3d color;
    std::function<double(Vec2<double> pixel)> alpha;
};

DrawnSplat ellipse_of(const Gaussians<Cpu>& g,
                      std::size_t i,
                      const Pinhole<double>& c,
                      double low) {
    const Vec3d p = c.camera_from_world * vec_cast<double>(g.means[i]);
    const Mat3<double> R = rotation(normalize(quat_cast<double>(g.quats[i])));
    SplatShape<double> shape{
        project_point(c, p),
        ellipse_root(image_ellipse(projection_jacobian(c, p), R,
                                   exp(vec_cast<double>(g.log_scales[i])), low)),
        1 / (1 + std::exp(-static_cast<double>(g.opacity_logits[i]))),
        {}};
    return {
        p.z, {}, [shape](Vec2<double> at) {
            return splat_alpha(shape, Vec2<double>{shape.mean.x - at.x, shape.mean.y - at.y}).alpha;
        }};
}

DrawnSplat surfel_of(const Gaussians<Cpu>& g, std::size_t i, const Pinhole<double>& c) {
    const Mat3<double> R =
        c.camera_from_world.R * rotation(normalize(quat_cast<double>(g.quats[i])));
    const Vec3d p = c.camera_from_world * vec_cast<double>(g.means[i]),
                s = exp(vec_cast<double>(g.log_scales[i]));
    SurfelShape<double> shape;
    const bool drawn =
        surfel_shape(c, SurfelAxes<double>{s.x * column(R, 0), s.y * column(R, 1), p},
                     1 / (1 + std::exp(-static_cast<double>(g.opacity_logits[i]))), shape);
    return {p.z, {}, [shape, drawn](Vec2<double> at) {
                return drawn ? surfel_hit(shape,
                                          Vec2<double>{at.x - shape.mean.x, at.y - shape.mean.y})
                                   .alpha
                             : 0.0;
            }};
}

/// Renders all splats in front of the camera; tries each at every pixel.
double loss(const std::string& backbone, const Gaussians<Cpu>& g, const MovedCamera& c) {
    const auto n = g.means.size();
    std::vector<Vec3d> sh;
    for (std::size_t k = 0; k < g.sh.size(); ++k) sh.push_back(vec_cast<double>(g.sh[k]));
    std::vector<DrawnSplat> splats;
    for (std::size_t i = 0; i < n; ++i) {
        splats.push_back(backbone == "surfel"
                             ? surfel_of(g, i, c.pinhole)
                             : ellipse_of(g, i, c.pinhole, backbone == "ewa" ? double(0.3f) : 0));
        splats.back().color = sh_color<double>(
            3, normalize(vec_cast<double>(g.means[i]) - c.centre), sh.data(), n, i);
    }
    std::stable_sort(splats.begin(), splats.end(),
                     [](const DrawnSplat& a, const DrawnSplat& b) { return a.depth < b.depth; });
    double sum = 0;
    for (std::size_t p = 0; p < kSide * kSide; ++p) {
        const Vec2<double> at{static_cast<double>(p % kSide) + 0.5,
                              static_cast<double>(p / kSide) + 0.5};
        double T = 1;
        Vec3d color{};
        for (const DrawnSplat& s : splats) {
            const double alpha = s.alpha(at), next = T * (1 - alpha);
            if (alpha == 0) continue;
            if (next < 1e-4) break;
            color += alpha * T * s.color;
            T = next;
        }
        sum += dot(weight_of(p), color) + coverage_weight(p) * T;
    }
    return sum;
}

template <class Device>
ImageGradients<Device> weights() {
    std::vector<Vec3f> color;
    std::vector<float> transmittance;
    for (std::size_t p = 0; p < kSide * kSide; ++p) {
        color.push_back(vec_cast<float>(weight_of(p)));
        transmittance.push_back(static_cast<float>(coverage_weight(p)));
    }
    ImageGradients<Device> by;
    copy(color, by.color), copy(transmittance, by.transmittance);
    return by;
}

template <class Device>
std::vector<double> gradient_of(const std::string& name,
                                const Gaussians<Cpu>& splats,
                                const Camera& camera,
                                Maps maps = Maps::color | Maps::coverage) {
    Gaussians<Device> g;
    copy(splats, g);
    auto backbone = make_backbone<Device>(name, {});
    EXPECT_TRUE(backbone->traits.has_camera_gradient);
    backbone->forward(g, camera, 3, maps);
    Buffer<double, Device> sum;
    copy(std::vector<double>(kCameraParameters, 0), sum);
    backbone->add_camera_gradient(g, weights<Device>(), sum.span());
    return to_host(sum);
}

/// Splats of all shapes around the origin, some with means beyond the image's edges, but not so far
/// that the projection's Jacobian is clamped; quaternions of any length.
Gaussians<Cpu> scene() {
    Gaussians<Cpu> g = random_gaussians(40, 8, 0.12);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const float length = 0.5f + 0.05f * static_cast<float>(i);
        Quatf& q = g.quats[i];
        q = {length * q.w, length * q.x, length * q.y, length * q.z};
        if (i % 10 == 0) {
            g.means[i].x = i % 20 == 0 ? 1.6f : -1.9f;
            g.log_scales[i] = {-0.2f, -0.4f, -1};
            g.opacity_logits[i] = 2;
        }
    }
    return g;
}

class OfCamera : public testing::TestWithParam<const char*> {};

TEST_P(OfCamera, AgainstDifferencesOfBruteForce) {
    const Gaussians<Cpu> g = scene();
    const Camera camera = test_camera(kSide, kSide);
    const std::vector<double> found = gradient_of<Cpu>(GetParam(), g, camera);
    for (int k = 0; k < kCameraParameters; ++k) {
        const auto difference = [&](double h) {
            return (loss(GetParam(), g, {camera, k, h}) - loss(GetParam(), g, {camera, k, -h})) /
                   (2 * h);
        };
        // A splat at its cut-off jumps; with one of the steps no splat is there.
        const double a = difference(1e-6), b = difference(3e-7), c = difference(1e-7);
        const double middle = std::max(std::min(a, b), std::min(std::max(a, b), c));
        EXPECT_TRUE(close(found[static_cast<std::size_t>(k)], middle, 1e-3, 5))
            << k << ": " << found[static_cast<std::size_t>(k)] << " for " << a << " " << b << " "
            << c;
        EXPECT_GT(std::abs(middle), 0.1) << k;  // otherwise the test shows nothing
    }
}

TEST_P(OfCamera, DoesNotDependOnMapsThatNobodyDifferentiates) {
    const Gaussians<Cpu> g = scene();
    const Camera camera = test_camera(kSide, kSide);
    const auto alone = gradient_of<Cpu>(GetParam(), g, camera),
               with = gradient_of<Cpu>(GetParam(), g, camera,
                                       Maps::color | Maps::coverage | kGeometryMaps);
    for (std::size_t k = 0; k < alone.size(); ++k) EXPECT_TRUE(close(alone[k], with[k], 1e-5, 5));
}

TEST_P(OfCamera, BitIdenticalForAnyNumberOfThreads) {
    const Gaussians<Cpu> g = random_gaussians(6000, 5, 0.1);
    const Camera camera = test_camera(kSide, kSide);
    const int threads = thread_count();
    set_thread_count(1);
    const auto one = gradient_of<Cpu>(GetParam(), g, camera);
    set_thread_count(3);
    const auto three = gradient_of<Cpu>(GetParam(), g, camera);
    set_thread_count(threads);
    EXPECT_EQ(0, std::memcmp(one.data(), three.data(), one.size() * sizeof(double)));
}

TEST_P(OfCamera, LeavesTheSplatsGradientsAsTheyAre) {
    const Gaussians<Cpu> g = scene();
    const auto run = [&](bool cameras) {
        auto backbone = make_backbone<Cpu>(GetParam(), {});
        backbone->forward(g, test_camera(kSide, kSide), 3, Maps::color | Maps::coverage);
        Buffer<double, Cpu> sum;
        copy(std::vector<double>(kCameraParameters, 0), sum);
        if (cameras) backbone->add_camera_gradient(g, weights<Cpu>(), sum.span());
        Gaussians<Cpu> dL;
        resize(dL, g.size(), 3);
        fill_zero(dL);
        backbone->backward(g, weights<Cpu>(), dL);
        return to_host(dL.means);
    };
    const auto without = run(false), with = run(true);
    EXPECT_EQ(0, std::memcmp(without.data(), with.data(), without.size() * sizeof(Vec3f)));
}

TEST_P(OfCamera, Twin) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const Gaussians<Cpu> g = scene();
        const Camera camera = test_camera(kSide, kSide);
        const auto cpu = gradient_of<Cpu>(GetParam(), g, camera),
                   cuda = gradient_of<Cuda>(GetParam(), g, camera),
                   again = gradient_of<Cuda>(GetParam(), g, camera);
        for (std::size_t k = 0; k < cpu.size(); ++k) EXPECT_TRUE(close(cuda[k], cpu[k], 1e-4, 5));
        EXPECT_EQ(0, std::memcmp(cuda.data(), again.data(), cuda.size() * sizeof(double)));
    }
}

INSTANTIATE_TEST_SUITE_P(Backbones, OfCamera, testing::Values("ewa", "rade", "surfel"));

TEST(RigidExp, IsTheLimitOfSmallMotions) {
    for (const double scale : {1.0, 1e-3, 1e-5, 0.0}) {
        const Vec3d turn = scale * Vec3d{0.3, -0.5, 0.7}, shift = scale * Vec3d{1, 2, -0.4};
        Rigid3d many;
        const double n = 1 << 20;
        for (int k = 0; k < 3; ++k) {
            Vec3d e{};
            e[k] = 1;
            const Vec3d c = e + cross(turn, e) / n + cross(turn, cross(turn, e)) / (2 * n * n);
            for (int r = 0; r < 3; ++r) many.R[r][k] = c[r];
        }
        many.t = shift / n + cross(turn, shift) / (2 * n * n);
        for (int i = 0; i < 20; ++i) many = many * many;
        const Rigid3d found = rigid_exp(turn, shift);
        for (int r = 0; r < 3; ++r) {
            EXPECT_NEAR(found.t[r], many.t[r], 1e-9 * scale + 1e-15);
            for (int c = 0; c < 3; ++c)
                EXPECT_NEAR(found.R[r][c], many.R[r][c], 1e-9 * scale + 1e-9);
        }
    }
}

}  // namespace
}  // namespace tvsgs
