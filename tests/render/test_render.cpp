// Tests the whole EWA rasteriser: against brute force in double, on scenes with known results, and
// between devices.

#include <algorithm>
#include <cstring>
#include <functional>

#include "core/device/threads.h"
#include "render/backbone.h"
#include "render/ewa/projection_math.h"
#include "render/tiles/blend_math.h"
#include "render/tiles/sh_math.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using test::close;
using test::random_gaussians;
using test::test_camera;

/// Parameters in double, for finite differences.
struct Reference {
    std::vector<Vec3d> means, log_scales, sh;
    std::vector<Quat<double>> quats;
    std::vector<double> logits;

    explicit Reference(const Gaussians<Cpu>& g) {
        for (std::size_t i = 0; i < g.means.size(); ++i) {
            means.push_back(vec_cast<double>(g.means[i]));
            log_scales.push_back(vec_cast<double>(g.log_scales[i]));
            quats.push_back(quat_cast<double>(g.quats[i]));
            logits.push_back(static_cast<double>(g.opacity_logits[i]));
        }
        for (std::size_t k = 0; k < g.sh.size(); ++k) sh.push_back(vec_cast<double>(g.sh[k]));
    }

    /// Channel sums of every pixel. Tries every splat at every pixel; calls drew() for each blended
    /// splat.
    std::vector<PixelForward<double>> render(
        const Camera& c, const std::function<void()>& drew = [] {}) const {
        const auto camera = pinhole<double>(c);
        const std::size_t n = means.size();
        std::vector<SplatShape<double>> shapes(n);
        std::vector<SplatFeatures<double>> features(n);
        std::vector<double> depth(n);
        std::vector<std::size_t> order;
        for (std::size_t i = 0; i < n; ++i) {
            const Vec3d p = camera.camera_from_world * means[i];
            if (p.z <= 0.2f) continue;
            const Mat3<double> R = rotation(normalize(quats[i]));
            shapes[i] = {project_point(camera, p),
                         ellipse_root(image_ellipse(projection_jacobian(camera, p), R,
                                                    exp(log_scales[i]), double(0.3f))),
                         1 / (1 + std::exp(-logits[i])),
                         {}};
            const Vec3d offset = means[i] - vec_cast<double>(camera_centre(c));
            const auto plane =
                camera_plane(camera.camera_from_world.R, R, smallest_axis(log_scales[i]), p);
            features[i] = {sh_color<double>(3, normalize(offset), sh.data(), n, i), plane.normal,
                           plane.distance};
            depth[i] = p.z;
            order.push_back(i);
        }
        std::stable_sort(order.begin(), order.end(),
                         [&](std::size_t a, std::size_t b) { return depth[a] < depth[b]; });
        std::vector<PixelForward<double>> pixels;
        for (int y = 0; y < c.height_px; ++y)
            for (int x = 0; x < c.width_px; ++x) {
                PixelForward<double> pixel;
                for (std::size_t i : order) {
                    const Vec2<double> d{shapes[i].mean.x - (x + 0.5),
                                         shapes[i].mean.y - (y + 0.5)};
                    const double alpha = splat_alpha(shapes[i], d).alpha;
                    if (alpha == 0) continue;
                    if (!blend<Channels::color_plane>(pixel, alpha, features[i])) break;
                    drew();
                }
                pixels.push_back(pixel);
            }
        return pixels;
    }
};

/// Smooth weights, so that a linear loss of the images exercises all channels.
SplatFeatures<double> pixel_weight(std::size_t p) {
    const double t = static_cast<double>(p);
    return {{std::sin(t), std::cos(2 * t), std::sin(3 * t + 1)},
            {std::cos(t), 0.3 * std::sin(t), 0.2},
            0.1 * std::cos(0.5 * t)};
}

double depth_of(const PixelForward<double>& pixel, const Camera& c, std::size_t p) {
    const int at = static_cast<int>(p), x = at % c.width_px, y = at / c.width_px;
    const Vec3d ray{(x + 0.5 - c.cx_px) / c.fx_px, (y + 0.5 - c.cy_px) / c.fy_px, 1};
    return plane_depth(pixel.sum.normal, pixel.sum.distance, ray, 1 - pixel.T);
}

/// `with_depth`: the pixels where depth is defined, which must not change when a splat moves.
double loss(const std::vector<PixelForward<double>>& pixels,
            const Camera& camera,
            const std::vector<char>& with_depth) {
    double sum = 0;
    for (std::size_t p = 0; p < pixels.size(); ++p) {
        const SplatFeatures<double> w = pixel_weight(p);
        sum += dot(w.color, pixels[p].sum.color) + dot(w.normal, pixels[p].sum.normal);
        if (with_depth[p]) sum += w.distance * depth_of(pixels[p], camera, p);
    }
    return sum;
}

template <class Device>
ImageGradients<Device> weight_images(int pixels) {
    std::vector<Vec3f> color, normal;
    std::vector<float> depth;
    for (int p = 0; p < pixels; ++p) {
        const auto w = pixel_weight(static_cast<std::size_t>(p));
        color.push_back(vec_cast<float>(w.color));
        normal.push_back(vec_cast<float>(w.normal));
        depth.push_back(static_cast<float>(w.distance));
    }
    ImageGradients<Device> g;
    copy(color, g.color), copy(normal, g.normal), copy(depth, g.depth);
    return g;
}

TEST(Render, AgainstBruteForceInDouble) {
    const auto g = random_gaussians(300, 7, 0.08);
    const Camera camera = test_camera(45, 37);  // not a multiple of the tile size
    auto backbone = make_backbone<Cpu>("ewa", {});
    const auto& images = backbone->forward(g, camera, 3, Maps::color | kGeometryMaps);
    const auto reference = Reference(g).render(camera);
    for (std::size_t p = 0; p < reference.size(); ++p) {
        // Float against double; 0.004 allows a splat at its 1/255 cut-off to differ as a whole.
        EXPECT_NEAR(images.transmittance[p], reference[p].T, 4e-3 * 1.01);
        for (int c = 0; c < 3; ++c)
            EXPECT_NEAR(images.color[p][c], reference[p].sum.color[c], 1e-4);
        if (images.depth[p] > 0 && images.transmittance[p] < 0.5f) {
            EXPECT_NEAR(images.depth[p], depth_of(reference[p], camera, p), 2e-2);
        }
    }
    double difference = 0, total = 0;
    for (std::size_t p = 0; p < reference.size(); ++p)
        for (int c = 0; c < 3; ++c) {
            difference += std::pow(images.color[p][c] - reference[p].sum.color[c], 2);
            total += std::pow(reference[p].sum.color[c], 2);
        }
    EXPECT_LT(std::sqrt(difference / total), 1e-5);
}

TEST(Render, BackwardAgainstDifferencesOfBruteForce) {
    const auto g = random_gaussians(40, 8, 0.1);
    const Camera camera = test_camera(32, 32);
    auto backbone = make_backbone<Cpu>("ewa", {});
    const auto& images = backbone->forward(g, camera, 3, Maps::color | kGeometryMaps);
    // Depth where it is well defined: grazing planes and almost empty pixels differ as a whole.
    std::vector<char> with_depth;
    auto weights = weight_images<Cpu>(32 * 32);
    for (std::size_t p = 0; p < images.depth.size(); ++p) {
        with_depth.push_back(images.depth[p] > 1 && images.depth[p] < 20 &&
                             images.transmittance[p] < 0.7f);
        if (!with_depth[p]) weights.depth[p] = 0;
    }
    ASSERT_GT(std::count(with_depth.begin(), with_depth.end(), 1), 200);
    Gaussians<Cpu> dL;
    resize(dL, g.size(), 3);
    fill_zero(dL);
    backbone->backward(g, weights, dL);

    Reference reference(g);
    // Splats appear and disappear at the 1/255 cut-off as a parameter moves, so differences are
    // smooth only for small steps: h = 1e-5, error ~1e-6 of the loss. The analytic side is float.
    // The specified bound is 1e-3 relative to the largest entry of the class.
    const auto derivative = [&](double& parameter) {
        const double kept = parameter, h = 1e-5;
        parameter = kept + h;
        const double high = loss(reference.render(camera), camera, with_depth);
        parameter = kept - h;
        const double low = loss(reference.render(camera), camera, with_depth);
        parameter = kept;
        return (high - low) / (2 * h);
    };
    int outliers = 0, checked = 0;
    const auto check = [&](double analytic, double& parameter, double scale) {
        ++checked;
        outliers += !close(analytic, derivative(parameter), 1e-3, scale);
    };
    for (std::size_t i = 0; i < 40; i += 3) {
        for (int axis = 0; axis < 3; ++axis) {
            check(dL.means[i][axis], reference.means[i][axis], 5);
            check(dL.log_scales[i][axis], reference.log_scales[i][axis], 1);
            check(dL.sh[2 * 40 + i][axis], reference.sh[2 * 40 + i][axis], 0.5);
        }
        check(dL.quats[i].w, reference.quats[i].w, 1);
        check(dL.quats[i].y, reference.quats[i].y, 1);
        check(dL.opacity_logits[i], reference.logits[i], 1);
    }
    // A cut-off crossed within 2h makes the difference quotient jump; only a few of the entries may
    // meet one.
    EXPECT_LE(outliers, checked / 20) << outliers << " of " << checked;
}

TEST(Render, PlaneOfSplatsHasExactDepthAndNormal) {
    // Flat splats, turned at random in their plane n.X = -delta (camera frame), of all opacities.
    const Vec3f n = normalize(Vec3f{0.3f, -0.2f, -0.9f});
    const float delta = 3;
    const Vec3f a = normalize(cross(n, Vec3f{0, 1, 0})), b = cross(n, a);
    test::Random random(9);
    Gaussians<Cpu> g = random_gaussians(600, 10);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const float u = float(random.uniform(-2, 2)), v = float(random.uniform(-2, 2)),
                    turn = float(random.uniform(0, 6.28));
        g.means[i] = -delta * n + u * a + v * b;
        // Columns: two tangents turned by `turn`, then the normal as the smallest axis.
        const Vec3f t1 = std::cos(turn) * a + std::sin(turn) * b, t2 = cross(n, t1);
        const Mat3f R{{{t1.x, t2.x, n.x}, {t1.y, t2.y, n.y}, {t1.z, t2.z, n.z}}};
        const float w = 0.5f * std::sqrt(std::max(1e-6f, 1 + R[0][0] + R[1][1] + R[2][2]));
        g.quats[i] = {w, (R[2][1] - R[1][2]) / (4 * w), (R[0][2] - R[2][0]) / (4 * w),
                      (R[1][0] - R[0][1]) / (4 * w)};
        g.log_scales[i] = {std::log(0.15f), std::log(0.1f), std::log(1e-4f)};
    }
    Camera camera = test_camera(80, 60);
    camera.camera_from_world = {};
    auto backbone = make_backbone<Cpu>("ewa", {});
    const auto& images = backbone->forward(g, camera, 0, kGeometryMaps);
    int covered = 0;
    for (int y = 0; y < 60; ++y)
        for (int x = 0; x < 80; ++x) {
            const std::size_t p = static_cast<std::size_t>(y) * 80 + static_cast<std::size_t>(x);
            if (images.depth[p] == 0) continue;
            ++covered;
            const float exact = delta / -dot(n, pixel_ray(camera, x, y));
            EXPECT_NEAR(images.depth[p], exact,
                        1e-5f * exact * 3);  // float: a few roundings of quaternion and blend
            EXPECT_LT(norm(normalize(images.normal[p]) - n), 2e-5f);
        }
    EXPECT_GT(covered, 2000);

    // Official rays pass half a pixel up and left of the centres: the same plane, but another
    // depth.
    BackboneOptions options;
    options.pixel_center = PixelCenter::official;
    auto official = make_backbone<Cpu>("ewa", options);
    const auto& shifted = official->forward(g, camera, 0, kGeometryMaps);
    for (int at = 30 * 80 + 20; at < 30 * 80 + 60; ++at) {
        const std::size_t p = static_cast<std::size_t>(at);
        ASSERT_GT(shifted.depth[p], 0);
        const Vec3f ray{(static_cast<float>(at % 80) - camera.cx_px) / camera.fx_px,
                        (static_cast<float>(at / 80) - camera.cy_px) / camera.fy_px, 1};
        const float exact = delta / -dot(n, ray);
        EXPECT_NEAR(shifted.depth[p], exact, 3e-5f * exact);
        EXPECT_GT(std::abs(shifted.depth[p] - images.depth[p]), 1e-4f * exact);
        EXPECT_EQ(shifted.normal[p].x, images.normal[p].x);  // blending does not depend on it
    }
}

TEST(Render, OneOpaqueSplat) {
    Gaussians<Cpu> g = random_gaussians(1, 11);
    g.means[0] = {0, 0, 0};
    g.log_scales[0] = {std::log(0.5f), std::log(0.5f), std::log(0.5f)};
    g.opacity_logits[0] = 20;
    for (std::size_t k = 0; k < 16; ++k) g.sh[k] = {};
    g.sh[0] = Vec3f{1, 1, 1} / (2 * float(kShC0));  // colour 1
    Camera camera = test_camera(33, 33);
    camera.cx_px = camera.cy_px = 16.5f;  // the centre of pixel 16
    camera.camera_from_world = {{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, {0, 0, 4}};
    auto backbone = make_backbone<Cpu>("ewa", {});
    const auto& images = backbone->forward(g, camera, 3, Maps::color);
    EXPECT_NEAR(images.color[16 * 33 + 16].x, 0.99f, 1e-6f);
    EXPECT_NEAR(images.transmittance[16 * 33 + 16], 0.01f, 1e-6f);
    // front_pixels counts the pixels in which it is blended.
    Gaussians<Cpu> dL;
    resize(dL, 1, 3);
    fill_zero(dL);
    const auto touched =
        std::count_if(images.transmittance.span().begin(), images.transmittance.span().end(),
                      [](float t) { return t < 1; });
    backbone->backward(g, {}, dL);
    EXPECT_EQ(backbone->statistics().front_pixels[0], touched);
    EXPECT_EQ(dL.means[0].x, 0);
}

TEST(Render, CulledAndBrokenSplatsDrawNothing) {
    Gaussians<Cpu> g = random_gaussians(6, 12);
    for (std::size_t i = 0; i < 6; ++i) g.means[i] = {0, 0, 0}, g.opacity_logits[i] = 3;
    g.means[0] = {0, 0, -3.85f};  // nearer than the near plane
    g.means[1] = {0, 0, -10};     // behind
    g.means[2] = {NAN, 0, 0};
    g.log_scales[3] = {NAN, 0, 0};
    g.log_scales[4] = {80, 80, 80};  // overflows
    g.opacity_logits[5] = -10;       // below 1/255
    auto backbone = make_backbone<Cpu>("ewa", {});
    const auto& images =
        backbone->forward(g, test_camera(20, 20, 0), 3, Maps::color | kGeometryMaps);
    for (std::size_t p = 0; p < 400; ++p) {
        EXPECT_EQ(images.transmittance[p], 1);
        EXPECT_EQ(images.color[p].x, 0);
        EXPECT_EQ(images.depth[p], 0);
    }
    for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(backbone->statistics().radii_px[i], 0);
}

TEST(Render, BitIdenticalForAnyNumberOfThreads) {
    const auto g = random_gaussians(500, 13);
    const Camera camera = test_camera(64, 48);
    const auto run = [&](int threads) {
        set_thread_count(threads);
        auto backbone = make_backbone<Cpu>("ewa", {});
        backbone->forward(g, camera, 3, Maps::color | kGeometryMaps);
        Gaussians<Cpu> dL;
        resize(dL, g.size(), 3);
        fill_zero(dL);
        backbone->backward(g, weight_images<Cpu>(64 * 48), dL);
        return to_host(dL.means);
    };
    const int threads = thread_count();
    const auto one = run(1), four = run(4);
    set_thread_count(threads);
    EXPECT_EQ(0, std::memcmp(one.data(), four.data(), one.size() * sizeof(Vec3f)));
}

TEST(Backbones, UnknownNameListsTheKnownOnes) {
    try {
        make_backbone<Cpu>("4dgs", {});
        FAIL();
    } catch (const std::exception& error) {
        EXPECT_NE(std::string(error.what()).find("ewa"), std::string::npos);
    }
}

/// sqrt(sum (a-b)^2 / sum a^2) over all floats.
template <class T>
double relative_l2(const std::vector<T>& a, const std::vector<T>& b) {
    const auto* x = reinterpret_cast<const float*>(a.data());
    const auto* y = reinterpret_cast<const float*>(b.data());
    double difference = 0, total = 1e-30;
    for (std::size_t i = 0; i < a.size() * sizeof(T) / sizeof(float); ++i) {
        difference += std::pow(static_cast<double>(x[i]) - static_cast<double>(y[i]), 2);
        total += std::pow(static_cast<double>(x[i]), 2);
    }
    return std::sqrt(difference / total);
}

template <class Device>
struct Outcome {
    std::vector<Vec3f> color, normal, means, log_scales, sh;
    std::vector<float> depth, transmittance, logits;
    std::vector<Quatf> quats;
    std::vector<Vec2f> abs_gradient;
    std::vector<int> front;
};

template <class Device>
Outcome<Device> run(const Gaussians<Cpu>& host, const Camera& camera, Maps maps) {
    Gaussians<Device> g, dL;
    copy(host, g);
    auto backbone = make_backbone<Device>("ewa", {});
    const auto& images = backbone->forward(g, camera, 3, maps);
    resize(dL, g.size(), 3);
    fill_zero(dL);
    backbone->backward(g, weight_images<Device>(camera.width_px * camera.height_px), dL);
    const auto& s = backbone->statistics();
    return {to_host(images.color),
            to_host(images.normal),
            to_host(dL.means),
            to_host(dL.log_scales),
            to_host(dL.sh),
            to_host(images.depth),
            to_host(images.transmittance),
            to_host(dL.opacity_logits),
            to_host(dL.quats),
            to_host(s.abs_dL_dmeans2d),
            to_host(s.front_pixels)};
}

template <class Device>
void twin(int count, Maps maps, double size, int width, int height) {
    const auto g = random_gaussians(count, 100 + static_cast<unsigned>(count), size);
    const Camera camera = test_camera(width, height);
    const auto cpu = run<Cpu>(g, camera, maps);
    const auto cuda = run<Device>(g, camera, maps), again = run<Device>(g, camera, maps);
    // exp differs by an ulp between the devices, so a splat at its cut-off may be drawn on one
    // device only: 1e-4 of the whole.
    const double images = 1e-4, gradients = 2e-3;
    const auto check = [&](const char* name, double difference, double bound) {
        std::printf("  n %-6d %-12s relative L2 %.2e\n", count, name, difference);
        EXPECT_LE(difference, bound) << name << " at " << count;
    };
    check("color", relative_l2(cpu.color, cuda.color), images);
    check("normal", relative_l2(cpu.normal, cuda.normal), images);
    check("depth", relative_l2(cpu.depth, cuda.depth), 1e-2);  // grazing pixels divide by almost 0
    check("T", relative_l2(cpu.transmittance, cuda.transmittance), images);
    check("dmeans", relative_l2(cpu.means, cuda.means), gradients);
    check("dscales", relative_l2(cpu.log_scales, cuda.log_scales), gradients);
    check("dquats", relative_l2(cpu.quats, cuda.quats), gradients);
    check("dlogits", relative_l2(cpu.logits, cuda.logits), gradients);
    check("dsh", relative_l2(cpu.sh, cuda.sh), gradients);
    check("abs", relative_l2(cpu.abs_gradient, cuda.abs_gradient), gradients);
    EXPECT_EQ(
        0, std::memcmp(cuda.means.data(), again.means.data(), again.means.size() * sizeof(Vec3f)))
        << "not reproducible";
    EXPECT_EQ(0, std::memcmp(cuda.sh.data(), again.sh.data(), again.sh.size() * sizeof(Vec3f)))
        << "not reproducible";
}

TEST(RenderTwin, CpuAgainstCuda) {
    if (const std::string reason = test::no_cuda(); !reason.empty()) GTEST_SKIP() << reason;
    if constexpr (kHasCuda) {
        for (int count : {0, 1, 31, 257, 20000})
            twin<Cuda>(count, Maps::color | kGeometryMaps, count > 1000 ? 0.02 : 0.1, 203, 151);
        twin<Cuda>(257, Maps::color, 0.1, 203, 151);
        twin<Cuda>(257, kGeometryMaps, 0.1, 203, 151);
        twin<Cuda>(300, Maps::color | kGeometryMaps, 3.0, 64, 64);  // every splat covers every tile
        twin<Cuda>(5000, Maps::color | kGeometryMaps, 0.2, 16, 16);  // one tile, long list
    }
}

template <class Device>
BlendWork work_of(const Gaussians<Cpu>& host, const Camera& camera) {
    Gaussians<Device> g;
    copy(host, g);
    const auto backbone = make_backbone<Device>("ewa", {});
    backbone->forward(g, camera, 3, Maps::color);
    return backbone->blend_work();
}

TEST(BlendWork, OfOneSplatOverAllPixels) {
    Gaussians<Cpu> g = random_gaussians(1, 1);
    g.means[0] = {0, 0, 0}, g.log_scales[0] = {3, 3, 3}, g.opacity_logits[0] = 0;
    const BlendWork w = work_of<Cpu>(g, test_camera(20, 9));
    EXPECT_EQ(w.tests, 3 * 2) << "warps in the image";
    EXPECT_EQ(w.hits, 6);
    EXPECT_EQ(w.evaluations, 20 * 9);
    EXPECT_EQ(w.contributions, 20 * 9);
    EXPECT_EQ(w.draws, 6);
    EXPECT_EQ(w.sums, 6);
}

TEST(BlendWork, AgainstEverySplatAtEveryPixel) {
    const Camera camera = test_camera(57, 43);
    const Gaussians<Cpu> g = random_gaussians(800, 4, 0.1);
    std::int64_t contributions = 0;
    Reference(g).render(camera, [&] { ++contributions; });
    const BlendWork w = work_of<Cpu>(g, camera);
    // Some of 50,000 alphas close to 1/255 lie on different sides in float and in double.
    EXPECT_GT(contributions, 10000);
    EXPECT_NEAR(static_cast<double>(w.contributions), static_cast<double>(contributions), 5);
    EXPECT_LE(w.contributions, w.evaluations);
    EXPECT_LE(w.evaluations, 64 * w.hits);
    EXPECT_LE(w.sums, w.draws);
    EXPECT_LE(w.draws, w.hits);
    EXPECT_LT(w.hits, w.tests);
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const BlendWork cuda = work_of<Cuda>(g, camera);
        EXPECT_NEAR(static_cast<double>(cuda.contributions), static_cast<double>(w.contributions),
                    5);
        EXPECT_NEAR(static_cast<double>(cuda.hits), static_cast<double>(w.hits), 5);
        EXPECT_NEAR(static_cast<double>(cuda.tests), static_cast<double>(w.tests), 5);
    }
}

}  // namespace
}  // namespace tvsgs
