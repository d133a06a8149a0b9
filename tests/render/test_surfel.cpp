// Tests the backbone `surfel` as a whole: against brute force in double, on a plane of known depth,
// in training, and between devices.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "core/error.h"
#include "double_splats.h"
#include "render/backbone.h"
#include "render/surfel/surfel_math.h"
#include "render/tiles/blend_math.h"
#include "render/tiles/sh_math.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using test::close;
using test::random_gaussians;
using test::test_camera;

constexpr Maps kAll = Maps::color | kGeometryMaps | Maps::distortion;

BackboneOptions with_depth(SurfaceDepth depth) {
    BackboneOptions options;
    options.depth = depth;
    return options;
}

struct Reference : test::DoubleSplats {
    using DoubleSplats::DoubleSplats;

    /// Tries every surfel at every pixel.
    std::vector<SurfelPixel<double>> render(const Camera& c) const {
        const auto camera = pinhole<double>(c);
        const std::size_t n = means.size();
        std::vector<SurfelShape<double>> shapes(n);
        std::vector<SurfelFeatures<double>> features(n);
        std::vector<std::size_t> order;
        for (std::size_t i = 0; i < n; ++i) {
            const Vec3d p = camera.camera_from_world * means[i];
            if (!(p.z > 0.2)) continue;
            const Mat3<double> R = camera.camera_from_world.R * rotation(normalize(quats[i]));
            const SurfelAxes<double> axes{std::exp(log_scales[i].x) * column(R, 0),
                                          std::exp(log_scales[i].y) * column(R, 1), p};
            const double opacity = 1 / (1 + std::exp(-logits[i]));
            if (!surfel_shape(camera, axes, opacity, shapes[i])) continue;
            const Vec3d normal = column(R, 2),
                        offset = means[i] - vec_cast<double>(camera_centre(c));
            features[i] = {sh_color<double>(3, normalize(offset), sh.data(), n, i),
                           (dot(normal, p) < 0 ? 1.0 : -1.0) * normal};
            order.push_back(i);
        }
        std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
            return shapes[a].inverse_depth > shapes[b].inverse_depth;
        });
        std::vector<SurfelPixel<double>> pixels(std::size_t(c.width_px) * std::size_t(c.height_px));
        for (std::size_t at = 0; at < pixels.size(); ++at) {
            const Vec2<double> centre{static_cast<double>(at % std::size_t(c.width_px)) + 0.5,
                                      static_cast<double>(at / std::size_t(c.width_px)) + 0.5};
            for (const std::size_t i : order)
                if (!blend<true>(pixels[at], surfel_hit(shapes[i], centre - shapes[i].mean),
                                 features[i]))
                    break;
        }
        return pixels;
    }
};

/// Surfels well above a pixel's size and seen from the front: for a surfel drawn as a dot, the
/// derivative treats the depth as constant over the image, unlike differences.
Gaussians<Cpu> large_surfels(int count, unsigned seed) {
    Gaussians<Cpu> g = random_gaussians(count, seed, 0.25);
    test::Random random(seed);
    const auto tilt = [&] { return static_cast<float>(random.uniform(-0.3, 0.3)); };
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        for (int axis = 0; axis < 2; ++axis)
            g.log_scales[i][axis] = std::max(g.log_scales[i][axis], std::log(0.15f));
        g.quats[i] = {1, tilt(), tilt(), 3 * tilt()};
    }
    return g;
}

TEST(Surfel, AgainstBruteForceInDouble) {
    for (const double size : {0.02, 0.2}) {
        const auto g = random_gaussians(300, 7, size);
        const Camera camera = test_camera(45, 37);  // not a multiple of the tile size
        const auto reference = Reference(g).render(camera);
        for (const SurfaceDepth depth : {SurfaceDepth::expected, SurfaceDepth::median}) {
            const auto backbone = make_backbone<Cpu>("surfel", with_depth(depth));
            const auto& images = backbone->forward(g, camera, 3, kAll);
            double off = 0, total = 0;
            int jumps = 0, covered = 0;
            for (std::size_t p = 0; p < reference.size(); ++p) {
                const SurfelPixel<double>& r = reference[p];
                // A splat at its 1/255 cut-off may differ as a whole.
                EXPECT_NEAR(images.transmittance[p], r.T, 4.1e-3);
                EXPECT_NEAR(images.distortion[p], r.distortion, 1e-3 + 1e-3 * r.distortion);
                for (int c = 0; c < 3; ++c) {
                    off += std::pow(images.color[p][c] - r.color[c], 2);
                    off += std::pow(images.normal[p][c] - r.normal[c], 2);
                    total += r.color[c] * r.color[c] + r.normal[c] * r.normal[c];
                }
                if (r.T > 0.9) continue;
                ++covered;
                const double d = depth == SurfaceDepth::median ? r.median : r.z / (1 - r.T);
                jumps += !close(images.depth[p], d, 2e-3, 1e-3);
            }
            EXPECT_LT(std::sqrt(off / total), 1e-4);
            EXPECT_GT(covered, 300);
            EXPECT_LE(jumps, covered / 100) << "medians jump where half of the light is left";
        }
    }
}

/// Weights of all maps, smooth over the image.
ImageGradients<Cpu> weights(std::size_t pixels) {
    test::Random random(3);
    std::vector<Vec3f> color, normal;
    std::vector<float> depth, distortion;
    for (std::size_t p = 0; p < pixels; ++p) {
        color.push_back(vec_cast<float>(random.normal3()));
        normal.push_back(vec_cast<float>(random.normal3()));
        depth.push_back(static_cast<float>(random.uniform(-1, 1)));
        distortion.push_back(static_cast<float>(random.uniform(-5, 5)));
    }
    ImageGradients<Cpu> g;
    copy(color, g.color), copy(normal, g.normal), copy(depth, g.depth);
    copy(distortion, g.distortion);
    return g;
}

class SurfelBackward : public testing::TestWithParam<SurfaceDepth> {};

TEST_P(SurfelBackward, AgainstDifferencesOfBruteForce) {
    const bool median = GetParam() == SurfaceDepth::median;
    const auto g = large_surfels(40, 8);
    const Camera camera = test_camera(32, 32);
    const auto backbone = make_backbone<Cpu>("surfel", with_depth(GetParam()));
    const auto& images = backbone->forward(g, camera, 3, kAll);
    ImageGradients<Cpu> by = weights(32 * 32);
    std::vector<char> has_depth;
    for (std::size_t p = 0; p < 32 * 32; ++p) {
        has_depth.push_back(images.transmittance[p] < 0.9f);
        if (!has_depth[p]) by.depth[p] = 0;
    }
    ASSERT_GT(std::count(has_depth.begin(), has_depth.end(), 1), 300);
    Gaussians<Cpu> dL;
    resize(dL, g.size(), 3);
    fill_zero(dL);
    backbone->backward(g, by, dL);

    Reference reference(g);
    const auto loss = [&] {
        double sum = 0;
        const auto pixels = reference.render(camera);
        for (std::size_t p = 0; p < pixels.size(); ++p) {
            const SurfelPixel<double>& r = pixels[p];
            sum += dot(vec_cast<double>(by.color[p]), r.color) +
                   dot(vec_cast<double>(by.normal[p]), r.normal) +
                   static_cast<double>(by.distortion[p]) * r.distortion;
            if (has_depth[p])
                sum += static_cast<double>(by.depth[p]) * (median ? r.median : r.z / (1 - r.T));
        }
        return sum;
    };
    test::Differences differences(loss, 2e-3);
    for (std::size_t i = 0; i < 40; i += 3) {
        for (int axis = 0; axis < 3; ++axis) {
            differences.check(dL.means[i][axis], reference.means[i][axis], 5);
            differences.check(dL.sh[2 * 40 + i][axis], reference.sh[2 * 40 + i][axis], 0.5);
        }
        differences.check(dL.log_scales[i].x, reference.log_scales[i].x, 1);
        differences.check(dL.log_scales[i].y, reference.log_scales[i].y, 1);
        differences.check(dL.quats[i].w, reference.quats[i].w, 1);
        differences.check(dL.quats[i].y, reference.quats[i].y, 1);
        differences.check(dL.opacity_logits[i], reference.logits[i], 1);
        EXPECT_EQ(dL.log_scales[i].z, 0);
    }
    // A cut-off crossed within 2h makes the difference jump, and so does a median that moves to
    // another splat.
    EXPECT_LE(differences.outliers, differences.checked / (median ? 8 : 20))
        << differences.outliers << " of " << differences.checked;
}

INSTANTIATE_TEST_SUITE_P(Depths,
                         SurfelBackward,
                         testing::Values(SurfaceDepth::expected, SurfaceDepth::median));

/// Surfels rotated at random in the plane n.X = -3 (camera frame), of all opacities.
TEST(Surfel, PlaneHasExactDepthAndNormal) {
    const Vec3f n = normalize(Vec3f{0.3f, -0.2f, -0.9f});
    const Vec3f a = normalize(cross(n, Vec3f{0, 1, 0})), b = cross(n, a);
    test::Random random(9);
    Gaussians<Cpu> g = random_gaussians(600, 10);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const float u = float(random.uniform(-2, 2)), v = float(random.uniform(-2, 2));
        test::lay_flat(g, i, -3 * n + u * a + v * b, n, {std::log(0.15f), std::log(0.1f), 0},
                       random);
    }
    Camera camera = test_camera(80, 60);
    camera.camera_from_world = {};
    for (const SurfaceDepth depth : {SurfaceDepth::expected, SurfaceDepth::median}) {
        const auto backbone = make_backbone<Cpu>("surfel", with_depth(depth));
        const auto& images = backbone->forward(g, camera, 0, kAll);
        int seen = 0;
        for (int y = 0; y < 60; ++y)
            for (int x = 0; x < 80; ++x) {
                const auto p = static_cast<std::size_t>(y * 80 + x);
                if (images.transmittance[p] > 0.5f) continue;
                ++seen;
                const float expected = -3 / dot(n, pixel_ray(camera, x, y));
                EXPECT_NEAR(images.depth[p], expected, 2e-4f * expected);
                EXPECT_NEAR(dot(normalize(images.normal[p]), n), 1, 1e-5);
                EXPECT_LT(images.distortion[p], 1e-5f);
            }
        EXPECT_GT(seen, 2000);
    }
}

TEST(Surfel, WhatIsNotMadeIsRefused) {
    try {
        make_backbone<Cpu>("surfel", with_depth(SurfaceDepth::plane));
        FAIL();
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::usage);
        EXPECT_NE(std::string(error.what()).find("surfel"), std::string::npos);
    }
}

TEST(Surfel, OptionsOfOtherRasterisersAreRefused) {
    BackboneOptions options;
    options.pixel_center = PixelCenter::official;
    EXPECT_NE(make_backbone<Cpu>("ewa", options), nullptr);
    try {
        make_backbone<Cpu>("surfel", options);
        FAIL();
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::usage);
        EXPECT_NE(std::string(error.what()).find("render.pixel_center"), std::string::npos);
    }
}

TEST(Surfel, VotersFindItsNormal) {
    Gaussians<Cpu> g = random_gaussians(20, 4, 0.1);
    make_backbone<Cpu>("surfel", {})->prepare(0, true, {}, g);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const Vec3f l = g.log_scales[i];
        EXPECT_NEAR(std::exp(l.z - std::min(l.x, l.y)), 1e-3, 1e-6);
    }
}

/// Allows one splat in two hundred (none on an H200) to differ by more than a thousandth of the
/// median size.
void expect_few_differ(const Buffer<Vec3f, Cpu>& a, const Buffer<Vec3f, Cpu>& b, Maps maps) {
    std::vector<float> sizes;
    for (std::size_t i = 0; i < a.size(); ++i)
        if (norm(a[i]) > 0) sizes.push_back(norm(a[i]));
    ASSERT_GT(sizes.size(), a.size() / 4);
    const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
    std::nth_element(sizes.begin(), middle, sizes.end());
    std::size_t differ = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
        differ += norm(a[i] - b[i]) > 1e-3f * std::max(norm(a[i]), *middle);
    EXPECT_LE(differ, sizes.size() / 200)
        << static_cast<unsigned>(maps) << ": " << differ << " of " << sizes.size();
}

/// A surfel smaller than a pixel is a dot with the depth of its centre.
TEST(Surfel, ADotsDepthGoesToItsCentre) {
    const Camera camera = test_camera(40, 30, 0.3f);
    const Mat3f& R = camera.camera_from_world.R;
    Gaussians<Cpu> g = random_gaussians(1, 5, 1e-4);
    g.quats[0] = {std::cos(0.15f), 0, -std::sin(0.15f), 0};  // faces the camera
    for (const Vec3f p : {Vec3f{0, 0, 0}, Vec3f{0.4f, -0.3f, 0.2f}}) {
        g.means[0] = p, g.opacity_logits[0] = 1;
        const auto backbone = make_backbone<Cpu>("surfel", with_depth(SurfaceDepth::expected));
        const auto& images = backbone->forward(g, camera, 0, kGeometryMaps);
        const float z = (camera.camera_from_world * p).z;
        ImageGradients<Cpu> by;
        std::vector<float> depth(images.depth.size());
        double sum = 0;
        int covered = 0;
        for (std::size_t at = 0; at < depth.size(); ++at) {
            depth[at] = 0.1f * static_cast<float>(at % 7);
            if (!(images.depth[at] > 0)) continue;
            EXPECT_NEAR(images.depth[at], z, 1e-4 * z);
            sum += depth[at], ++covered;
        }
        ASSERT_GT(covered, 4);
        copy(depth, by.depth);
        Gaussians<Cpu> dL;
        resize(dL, 1, 3), fill_zero(dL);
        backbone->backward(g, by, dL);
        const Vec3f expected = transpose_times(R, Vec3f{0, 0, static_cast<float>(sum)});
        EXPECT_LT(norm(dL.means[0] - expected), 1e-3 * sum);
    }
}

TEST(SurfelTwins, CpuAgainstCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const auto g = random_gaussians(2000, 7, 0.1);
        const Camera camera = test_camera(90, 70);
        const std::size_t pixels = 90 * 70;
        Gaussians<Cuda> there;
        copy(g, there);
        const ImageGradients<Cpu> by = weights(pixels);
        ImageGradients<Cuda> by_there;
        copy(to_host(by.color), by_there.color), copy(to_host(by.normal), by_there.normal);
        copy(to_host(by.depth), by_there.depth);
        copy(to_host(by.distortion), by_there.distortion);
        for (const SurfaceDepth depth : {SurfaceDepth::expected, SurfaceDepth::median})
            for (const Maps maps : {Maps::color, kGeometryMaps | Maps::distortion, kAll}) {
                const auto cpu = make_backbone<Cpu>("surfel", with_depth(depth));
                const auto cuda = make_backbone<Cuda>("surfel", with_depth(depth));
                const auto& a = cpu->forward(g, camera, 3, maps);
                const auto& b = cuda->forward(there, camera, 3, maps);
                const auto same = [](const auto& x, const auto& y, double bound) {
                    double off = 0, total = 1e-12;
                    const auto* const p = reinterpret_cast<const float*>(x.data());
                    const auto* const q = reinterpret_cast<const float*>(y.data());
                    for (std::size_t i = 0; i < x.size() * sizeof(x[0]) / sizeof(float); ++i)
                        off += std::pow(p[i] - q[i], 2), total += std::pow(p[i], 2);
                    EXPECT_LT(std::sqrt(off / total), bound);
                };
                EXPECT_EQ(a.color.size(), b.color.size());
                EXPECT_EQ(a.distortion.size(), b.distortion.size());
                same(to_host(a.transmittance), to_host(b.transmittance), 1e-4);
                same(to_host(a.color), to_host(b.color), 1e-4);
                same(to_host(a.normal), to_host(b.normal), 1e-4);
                same(to_host(a.depth), to_host(b.depth), 2e-2);  // medians jump
                same(to_host(a.distortion), to_host(b.distortion), 1e-3);
                Gaussians<Cpu> dL, dL_host;
                Gaussians<Cuda> dL_there;
                resize(dL, g.size(), 3), fill_zero(dL);
                resize(dL_there, g.size(), 3), fill_zero(dL_there);
                cpu->backward(g, by, dL);
                cuda->backward(there, by_there, dL_there);
                copy(dL_there, dL_host);
                // A splat at its cut-off, or a median that moves to another splat, changes a
                // pixel's gradient. So the sums may differ, but only of few splats.
                expect_few_differ(dL.means, dL_host.means, maps);
                same(to_host(dL.means), to_host(dL_host.means), 2e-3);
                same(to_host(dL.quats), to_host(dL_host.quats), 5e-2);
                same(to_host(dL.opacity_logits), to_host(dL_host.opacity_logits), 1e-2);
                same(to_host(dL.sh), to_host(dL_host.sh), 1e-3);
                same(to_host(cpu->statistics().dL_dmeans2d),
                     to_host(cuda->statistics().dL_dmeans2d), 5e-2);
                Gaussians<Cuda> again;
                resize(again, g.size(), 3), fill_zero(again);
                cuda->backward(there, by_there, again);
                Gaussians<Cpu> again_host;
                copy(again, again_host);
                EXPECT_EQ(to_host(again_host.opacity_logits), to_host(dL_host.opacity_logits));
            }
    }
}

}  // namespace
}  // namespace tvsgs
