// Tests the backbone `rade` as a whole: against brute force in double, on planes of known depth,
// and at its limits.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "core/error.h"
#include "double_splats.h"
#include "rade_case.h"
#include "render/rade/rade_math.h"
#include "render/tiles/blend_math.h"
#include "render/tiles/sh_math.h"

namespace tvsgs {
namespace {

using test::close;
using test::filtered_gaussians;
using test::random_gaussians;
using test::test_camera;
using test::with_depth;

constexpr Maps kAll = test::kAllRadeMaps;

struct Pixel {
    double T = 1, distance = 0, median = 0;
    Vec3d color{}, normal{};
};

struct Reference : test::DoubleSplats {
    using DoubleSplats::DoubleSplats;

    /// Tries every splat at every pixel. Returns distances, not yet depths.
    std::vector<Pixel> render(const Camera& c) const {
        const auto camera = pinhole<double>(c);
        const std::size_t n = means.size();
        std::vector<Vec2<double>> centres(n);
        std::vector<Sym2<double>> covariances(n);
        std::vector<RadePlane<double>> planes(n);
        std::vector<Vec3d> colors(n);
        std::vector<double> opacities(n), depths(n);
        std::vector<std::size_t> order;
        for (std::size_t i = 0; i < n; ++i) {
            const Vec3d p = camera.camera_from_world * means[i];
            if (!(p.z > 0.2)) continue;
            const Mat3<double> R = rotation(normalize(quats[i]));
            Vec3d scales;
            opacities[i] = 1 / (1 + std::exp(-logits[i]));
            for (int k = 0; k < 3; ++k) {
                const double s = std::exp(log_scales[i][k]);
                scales[k] = std::sqrt(s * s + filters[i] * filters[i]);
                opacities[i] *= s / scales[k];
            }
            const auto e = image_ellipse(projection_jacobian(camera, p), R, scales, 0.0);
            centres[i] = project_point(camera, p), covariances[i] = e.covariance;
            planes[i] = rade_plane(camera, {camera.camera_from_world.R * R, scales}, p);
            colors[i] = sh_color<double>(
                3, normalize(means[i] - vec_cast<double>(camera_centre(c))), sh.data(), n, i);
            depths[i] = p.z;
            order.push_back(i);
        }
        std::stable_sort(order.begin(), order.end(),
                         [&](std::size_t a, std::size_t b) { return depths[a] < depths[b]; });
        std::vector<Pixel> pixels(std::size_t(c.width_px) * std::size_t(c.height_px));
        for (std::size_t at = 0; at < pixels.size(); ++at) {
            Pixel& pixel = pixels[at];
            const double x = static_cast<double>(at % std::size_t(c.width_px)) + 0.5,
                         y = static_cast<double>(at / std::size_t(c.width_px)) + 0.5;
            for (const std::size_t i : order) {
                const Vec2<double> d{centres[i].x - x, centres[i].y - y};
                const Sym2<double> S = covariances[i];
                const double det = S.xx * S.yy - S.xy * S.xy;
                const double power =
                    -0.5 * (S.yy * d.x * d.x - 2 * S.xy * d.x * d.y + S.xx * d.y * d.y) / det;
                const double alpha = std::min(0.99, opacities[i] * std::exp(power));
                if (alpha < 1.0 / 255) continue;
                if (pixel.T * (1 - alpha) < 1e-4) break;
                const double w = alpha * pixel.T,
                             distance = planes[i].distance + dot(planes[i].slope, d);
                pixel.color += w * colors[i], pixel.normal += w * planes[i].normal;
                pixel.distance += w * distance;
                if (pixel.T > 0.5) pixel.median = distance;
                pixel.T *= 1 - alpha;
            }
        }
        return pixels;
    }
};

double ray_length(const Camera& camera, std::size_t at) {
    const int w = camera.width_px;
    return norm(vec_cast<double>(pixel_ray(camera, int(at) % w, int(at) / w)));
}

TEST(Rade, AgainstBruteForceInDouble) {
    for (const double size : {0.03, 0.2}) {
        const auto g = filtered_gaussians(300, 7, size);
        const Camera camera = test_camera(45, 37);  // not a multiple of the tile size
        const auto reference = Reference(g).render(camera);
        for (const SurfaceDepth depth : {SurfaceDepth::expected, SurfaceDepth::median}) {
            const bool median = depth == SurfaceDepth::median;
            const auto backbone = make_backbone<Cpu>("rade", with_depth(depth));
            const auto& images = backbone->forward(g, camera, 3, kAll);
            double off = 0, total = 0;
            int jumps = 0, covered = 0, turned = 0;
            for (std::size_t p = 0; p < reference.size(); ++p) {
                const Pixel& r = reference[p];
                const double ray = ray_length(camera, p);
                // A splat at its 1/255 cut-off may differ as a whole.
                EXPECT_NEAR(images.transmittance[p], r.T, 4.1e-3);
                for (int c = 0; c < 3; ++c) {
                    off += std::pow(images.color[p][c] - r.color[c], 2);
                    total += r.color[c] * r.color[c];
                }
                if (r.T > 0.9) continue;
                ++covered;
                const double mean = r.distance / ((1 - r.T) * ray);
                jumps += !close(images.depth[p], median ? r.median / ray : mean, 2e-3, 1e-3);
                EXPECT_TRUE(close(images.expected_depth[p], mean, 5e-3));
                EXPECT_NEAR(norm(images.normal[p]), 1, 1e-5);
                turned += !(dot(vec_cast<double>(images.normal[p]), normalize(r.normal)) > 0.9999);
            }
            EXPECT_LT(std::sqrt(off / total), 1e-4);
            EXPECT_GT(covered, 300);
            EXPECT_LE(jumps, covered / 100) << "medians jump where half of the light is left";
            EXPECT_LE(turned, covered / 100);
        }
    }
}

/// Maps that were not requested are not made, and do not change the requested ones.
TEST(Rade, ColoursAloneAreTheSameColours) {
    const auto g = filtered_gaussians(200, 3, 0.1);
    const Camera camera = test_camera(40, 30);
    const auto backbone = make_backbone<Cpu>("rade", {});
    const auto all = to_host(backbone->forward(g, camera, 3, kAll).color);
    const auto geometry = backbone->forward(g, camera, 3, kGeometryMaps).color.size();
    EXPECT_EQ(geometry, 0u);
    const auto& images = backbone->forward(g, camera, 3, Maps::color);
    EXPECT_TRUE(images.normal.empty() && images.depth.empty() && images.expected_depth.empty());
    for (std::size_t p = 0; p < all.size(); ++p) EXPECT_EQ(norm(images.color[p] - all[p]), 0);
    EXPECT_FALSE(has(backbone->traits.maps, Maps::distortion));
    EXPECT_TRUE(has(backbone->traits.maps, Maps::expected_depth));
}

class RadeBackward : public testing::TestWithParam<SurfaceDepth> {};

TEST_P(RadeBackward, AgainstDifferencesOfBruteForce) {
    const bool median = GetParam() == SurfaceDepth::median;
    constexpr std::size_t n = 40;
    auto g = filtered_gaussians(n, 8, 0.2);
    Camera camera = test_camera(32, 32);
    camera.fx_px *= 2.5f, camera.fy_px *= 2.5f;  // some centres are clamped
    const auto backbone = make_backbone<Cpu>("rade", with_depth(GetParam()));
    const auto& images = backbone->forward(g, camera, 3, kAll);
    ImageGradients<Cpu> by = test::weights_of_maps(32 * 32);
    std::size_t covered = 0;
    for (std::size_t p = 0; p < 32 * 32; ++p) {
        if (images.transmittance[p] < 0.9f)
            ++covered;
        else
            by.depth[p] = by.expected_depth[p] = 0, by.normal[p] = {};
    }
    ASSERT_GT(covered, 300u);
    int clamped = 0;
    const auto exact = pinhole<float>(camera);
    for (std::size_t i = 0; i < n; ++i) {
        const Vec3f p = camera.camera_from_world * g.means[i];
        clamped += backbone->statistics().radii_px[i] > 0 &&
                   (p.x / p.z < exact.u_min || p.x / p.z > exact.u_max || p.y / p.z < exact.v_min ||
                    p.y / p.z > exact.v_max);
    }
    EXPECT_GT(clamped, 0);
    Gaussians<Cpu> dL;
    resize(dL, g.size(), 3);
    fill_zero(dL);
    backbone->backward(g, by, dL);

    Reference reference(g);
    const auto loss = [&] {
        double sum = 0;
        const auto pixels = reference.render(camera);
        for (std::size_t p = 0; p < pixels.size(); ++p) {
            const Pixel& r = pixels[p];
            const double ray = ray_length(camera, p), mean = r.distance / ((1 - r.T) * ray);
            sum += dot(vec_cast<double>(by.color[p]), r.color) +
                   dot(vec_cast<double>(by.normal[p]), normalize(r.normal));
            if (by.depth[p] != 0)
                sum += static_cast<double>(by.depth[p]) * (median ? r.median / ray : mean) +
                       static_cast<double>(by.expected_depth[p]) * mean;
        }
        return sum;
    };
    test::Differences differences(loss, 2e-3);
    for (std::size_t i = 0; i < n; i += 2) {
        for (int axis = 0; axis < 3; ++axis) {
            differences.check(dL.means[i][axis], reference.means[i][axis], 5);
            differences.check(dL.log_scales[i][axis], reference.log_scales[i][axis], 1);
            differences.check(dL.sh[2 * n + i][axis], reference.sh[2 * n + i][axis], 0.5);
        }
        differences.check(dL.quats[i].w, reference.quats[i].w, 1);
        differences.check(dL.quats[i].y, reference.quats[i].y, 1);
        differences.check(dL.opacity_logits[i], reference.logits[i], 1);
    }
    // A cut-off crossed within 2h makes the difference jump, and so does a median that moves to
    // another splat.
    EXPECT_LE(differences.outliers, differences.checked / (median ? 8 : 25))
        << differences.outliers << " of " << differences.checked;
}

INSTANTIATE_TEST_SUITE_P(Depths,
                         RadeBackward,
                         testing::Values(SurfaceDepth::expected, SurfaceDepth::median));

/// Splats of a size, flat and rotated at random, in a plane that meets the axis at 3 units. Returns
/// the RMS of both depths' relative errors, and the largest error of the normals (1 - cosine).
struct PlaneErrors {
    double expected = 0, median = 0, normal = 0;
    int seen = 0;
};
PlaneErrors errors_on_plane(float size) {
    const Vec3f n = normalize(Vec3f{0.3f, -0.2f, -0.9f});
    const Vec3f a = normalize(cross(n, Vec3f{0, 1, 0})), b = cross(n, a);
    test::Random random(9);
    const int count = static_cast<int>(3 / (size * size));
    Gaussians<Cpu> g = random_gaussians(count, 10);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const float u = float(random.uniform(-0.7, 0.7)), v = float(random.uniform(-0.7, 0.7));
        test::lay_flat(g, i, Vec3f{0, 0, 3} + u * a + v * b, n,
                       {std::log(size), std::log(0.7f * size), std::log(1e-4f * size)}, random);
    }
    Camera camera = test_camera(80, 60);
    camera.camera_from_world = {};
    const auto backbone = make_backbone<Cpu>("rade", {});
    const auto& images = backbone->forward(g, camera, 0, kAll);
    PlaneErrors errors;
    for (int y = 20; y < 40; ++y)
        for (int x = 20; x < 60; ++x) {
            const auto p = static_cast<std::size_t>(y * 80 + x);
            if (images.transmittance[p] > 0.5f) continue;
            ++errors.seen;
            const double expected = 3 * n.z / dot(n, pixel_ray(camera, x, y));
            errors.expected += std::pow(images.expected_depth[p] / expected - 1, 2);
            errors.median += std::pow(images.depth[p] / expected - 1, 2);
            errors.normal = std::max(errors.normal, double{1 - dot(images.normal[p], n)});
        }
    errors.expected = std::sqrt(errors.expected / errors.seen);
    errors.median = std::sqrt(errors.median / errors.seen);
    return errors;
}

/// First-order accurate about each centre: the error falls with the square of size / depth.
TEST(Rade, ErrorsOnAPlaneFallWithTheSquareOfTheSize) {
    const PlaneErrors coarse = errors_on_plane(0.2f), fine = errors_on_plane(0.05f);
    EXPECT_GT(coarse.seen, 500);
    EXPECT_GT(fine.seen, 500);
    EXPECT_LT(coarse.expected, 1e-2);
    EXPECT_GT(coarse.median, 1e-4) << "not the exact plane";
    // Sixteen times, apart from the positions of the pixels.
    EXPECT_LT(fine.expected, coarse.expected / 8);
    EXPECT_LT(fine.median, coarse.median / 8);
    EXPECT_LT(fine.normal, 1e-4);
}

/// Two layers in front of the camera: the median is the back one, the mean lies between.
TEST(Rade, MedianAndMeanOfTwoLayers) {
    Gaussians<Cpu> g = random_gaussians(2, 1, 1.0, 0);
    Camera camera = test_camera(17, 17);
    camera.camera_from_world = {};
    camera.cx_px = camera.cy_px = 8.5f;
    for (std::size_t i = 0; i < 2; ++i) {
        g.means[i] = {0, 0, i == 0 ? 2.0f : 5.0f};
        g.log_scales[i] = {1, 1, -8};
        g.quats[i] = {1, 0, 0, 0};
        const float o = i == 0 ? 0.4f : 0.9f;
        g.opacity_logits[i] = std::log(o / (1 - o));
    }
    for (const SurfaceDepth depth : {SurfaceDepth::automatic, SurfaceDepth::expected}) {
        const auto backbone = make_backbone<Cpu>("rade", with_depth(depth));
        const auto& images = backbone->forward(g, camera, 0, kAll);
        const std::size_t centre = 8 * 17 + 8;
        const float mean = (0.4f * 2 + 0.54f * 5) / 0.94f;
        EXPECT_NEAR(images.expected_depth[centre], mean, 1e-4);
        EXPECT_NEAR(images.depth[centre], depth == SurfaceDepth::expected ? mean : 5, 1e-4);
        EXPECT_NEAR(norm(images.normal[centre] - Vec3f{0, 0, -1}), 0, 1e-5);
    }
}

TEST(Rade, NothingDrawnHasNoDepthAndNoNormal) {
    Gaussians<Cpu> g = random_gaussians(1, 1, 0.01, 0);
    g.means[0] = {0, 0, 0};
    const auto backbone = make_backbone<Cpu>("rade", {});
    const auto& images = backbone->forward(g, test_camera(32, 32), 0, kAll);
    EXPECT_EQ(images.depth[0], 0);
    EXPECT_EQ(images.expected_depth[0], 0);
    EXPECT_EQ(norm(images.normal[0]), 0);
    Gaussians<Cpu> dL;
    resize(dL, 1, 0);
    fill_zero(dL);
    backbone->backward(g, test::weights_of_maps(32 * 32), dL);
    EXPECT_TRUE(is_finite(dL.means[0]) && is_finite(dL.log_scales[0]));
}

/// Round splats of 0.031 and 0.032 px without a filter: their determinants are about 1e-6 px^4.
TEST(Rade, SplatsFinerThanAThousandthOfAPixelSquaredVanish) {
    Gaussians<Cpu> g = random_gaussians(1, 1, 0.01, 0);
    Camera camera = test_camera(17, 17);
    camera.camera_from_world = {};
    camera.cx_px = camera.cy_px = 8.5f, camera.fx_px = camera.fy_px = 20;
    g.means[0] = {0, 0, 2};
    g.quats[0] = {1, 0, 0, 0};
    g.opacity_logits[0] = 2;
    const auto backbone = make_backbone<Cpu>("rade", {});
    for (const float px : {0.031f, 0.032f}) {
        const float l = std::log(px / 10);
        g.log_scales[0] = {l, l, l};
        const float T = backbone->forward(g, camera, 0, Maps::color).transmittance[8 * 17 + 8];
        EXPECT_NEAR(T, px < 0.0315f ? 1 : 1 - 1 / (1 + std::exp(-2.0f)), 1e-5) << px;
    }
}

TEST(Rade, BrokenSplatsAreNotDrawn) {
    Gaussians<Cpu> g = filtered_gaussians(12, 5, 0.2);
    const float nan = std::nanf(""), inf = std::numeric_limits<float>::infinity();
    g.means[0].x = nan, g.means[1].y = inf, g.log_scales[2].x = nan, g.log_scales[3].y = inf;
    g.log_scales[4] = {-inf, -inf, -inf}, g.filter[4] = 0;
    g.opacity_logits[5] = nan, g.filter[6] = nan, g.filter[7] = inf, g.quats[8].w = nan;
    g.log_scales[9] = {-40, -40, -40}, g.filter[9] = 0;
    const auto backbone = make_backbone<Cpu>("rade", {});
    const Camera camera = test_camera(32, 32);
    const auto& images = backbone->forward(g, camera, 3, kAll);
    for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(backbone->statistics().radii_px[i], 0) << i;
    for (std::size_t p = 0; p < images.color.size(); ++p)
        ASSERT_TRUE(is_finite(images.color[p]) && is_finite(images.normal[p]) &&
                    std::isfinite(images.depth[p]) && std::isfinite(images.expected_depth[p]));
}

TEST(Rade, WhatItDoesNotGoByIsRefused) {
    BackboneOptions plane, center;
    plane.depth = SurfaceDepth::plane;
    center.pixel_center = PixelCenter::official;
    for (const auto& [options, key] :
         {std::pair{plane, "render.depth"}, {center, "render.pixel_center"}}) {
        try {
            make_backbone<Cpu>("rade", options);
            FAIL() << key;
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::usage);
            EXPECT_NE(std::string(error.what()).find(key), std::string::npos);
            EXPECT_NE(std::string(error.what()).find("'rade'"), std::string::npos);
        }
    }
}

}  // namespace
}  // namespace tvsgs
