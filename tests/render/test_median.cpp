// Tests depth along rays, mean and median, in the whole rasteriser: against brute force in double,
// on known surfaces, with extreme inputs, and between devices.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "core/device/threads.h"
#include "core/error.h"
#include "double_splats.h"
#include "render/backbone.h"
#include "render/depth/median_math.h"
#include "render/tiles/blend_math.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using test::close;
using test::random_gaussians;
using test::test_camera;

constexpr Maps kAll = Maps::color | kGeometryMaps;
constexpr SurfaceDepth kKinds[] = {SurfaceDepth::expected, SurfaceDepth::median};

template <class Device = Cpu>
auto backbone_with(SurfaceDepth depth, PixelCenter center = PixelCenter::exact) {
    BackboneOptions options;
    options.depth = depth, options.pixel_center = center;
    return make_backbone<Device>("ewa", options);
}

/// One pixel by the definitions.
struct ReferencePixel {
    double T, mean, median;
    double slope;  // of T at the median
};

struct Reference : test::DoubleSplats {
    using DoubleSplats::DoubleSplats;

    struct OnRay {
        double alpha, depth, deviation;
    };
    /// sqrt(1 - g) in front of the centre, (1 - a) / sqrt(1 - g) behind.
    static double light(const std::vector<OnRay>& splats, double t) {
        double T = 1;
        for (const OnRay& s : splats) {
            const double x = (t - s.depth) / s.deviation, g = s.alpha * std::exp(-x * x / 2);
            T *= t <= s.depth ? std::sqrt(1 - g) : (1 - s.alpha) / std::sqrt(1 - g);
        }
        return T;
    }

    std::vector<ReferencePixel> render(const Camera& c, double shift = 0) const {
        const auto camera = pinhole<double>(c);
        std::vector<SplatShape<double>> shapes(means.size());
        std::vector<Mat3<double>> root(means.size());  // diag(1/s) R^T, in the camera's frame
        std::vector<Vec3d> p(means.size());
        std::vector<std::size_t> order;
        for (std::size_t i = 0; i < means.size(); ++i) {
            p[i] = camera.camera_from_world * means[i];
            if (p[i].z <= 0.2) continue;
            const Mat3<double> R = rotation(normalize(quats[i]));
            const Vec3d scales = exp(log_scales[i]);
            shapes[i] = {project_point(camera, p[i]),
                         ellipse_root(image_ellipse(projection_jacobian(camera, p[i]), R, scales,
                                                    double(0.3f))),
                         1 / (1 + std::exp(-logits[i])),
                         {}};
            for (int k = 0; k < 3; ++k) {
                const Vec3d axis = camera.camera_from_world.R * column(R, k);
                const double s = std::max(scales[k], double(kLeastThickness) * p[i].z);
                for (int j = 0; j < 3; ++j) root[i][k][j] = axis[j] / s;
            }
            order.push_back(i);
        }
        std::stable_sort(order.begin(), order.end(),
                         [&](std::size_t a, std::size_t b) { return p[a].z < p[b].z; });
        std::vector<ReferencePixel> pixels;
        for (int y = 0; y < c.height_px; ++y)
            for (int x = 0; x < c.width_px; ++x) {
                const Vec3d ray{(x + 0.5 + shift - camera.cx) / camera.fx,
                                (y + 0.5 + shift - camera.cy) / camera.fy, 1};
                ReferencePixel& pixel = pixels.emplace_back(ReferencePixel{1, 0, 0, 0});
                std::vector<OnRay> splats;
                for (const std::size_t i : order) {
                    const Vec2<double> d{shapes[i].mean.x - (x + 0.5),
                                         shapes[i].mean.y - (y + 0.5)};
                    const double alpha = splat_alpha(shapes[i], d).alpha;
                    if (alpha == 0) continue;
                    if (pixel.T * (1 - alpha) < 1e-4) break;
                    const Vec3d r = root[i] * ray;
                    const double depth = dot(r, root[i] * p[i]) / dot(r, r);
                    if (pixel.T >= double(kDepthTransmittance) && splats.size() < kDepthSplats)
                        splats.push_back({alpha, depth, 1 / norm(r)});
                    pixel.mean += alpha * pixel.T * depth;
                    pixel.T *= 1 - alpha;
                }
                pixel.mean = pixel.T < 1 - 1e-4 ? pixel.mean / (1 - pixel.T) : 0;
                if (pixel.T > 0.5) continue;
                double low = 0, high = 100;
                for (int turn = 0; turn < 60; ++turn) {
                    const double middle = 0.5 * (low + high);
                    (light(splats, middle) > 0.5 ? low : high) = middle;
                }
                pixel.median = 0.5 * (low + high);
                const double h = 1e-6;
                pixel.slope =
                    (light(splats, pixel.median + h) - light(splats, pixel.median - h)) / (2 * h);
            }
        return pixels;
    }
};

double of(const ReferencePixel& pixel, SurfaceDepth kind) {
    return kind == SurfaceDepth::median ? pixel.median : pixel.mean;
}

TEST(RayDepth, AgainstBruteForceInDouble) {
    const Camera camera = test_camera(45, 37);  // not a multiple of the tile size
    for (const double size : {0.03, 0.15})
        for (const PixelCenter center : {PixelCenter::exact, PixelCenter::official}) {
            const auto g = random_gaussians(400, 7, size);
            const auto reference =
                Reference(g).render(camera, center == PixelCenter::official ? -0.5 : 0);
            for (const SurfaceDepth kind : kKinds) {
                const auto backbone = backbone_with(kind, center);
                const auto& images = backbone->forward(g, camera, 3, kAll);
                int covered = 0, off = 0;
                for (std::size_t p = 0; p < reference.size(); ++p) {
                    const ReferencePixel& r = reference[p];
                    ASSERT_NEAR(images.transmittance[p], r.T, 4.1e-3);
                    if (kind == SurfaceDepth::median && r.T > 0.51) {
                        EXPECT_EQ(images.depth[p], 0) << "half of the light gets through";
                    }
                    if (r.T > 0.49) continue;
                    ++covered;
                    const double d = static_cast<double>(images.depth[p]);
                    // Compared as light: the median may be off by 2e-3, the ends of profiles by
                    // 1e-3. A splat at its 1/255 cut-off may differ as a whole.
                    off += kind == SurfaceDepth::median
                               ? std::abs(d - r.median) * std::abs(r.slope) > 3e-3 &&
                                     std::abs(d - r.median) > 1e-4
                               : !close(d, r.mean, 2e-4);
                }
                EXPECT_GT(covered, 250);
                EXPECT_LE(off, covered / 100) << covered;
            }
        }
}

/// Derivatives of all depths with weight, where depth is defined.
ImageGradients<Cpu> weights(const std::vector<char>& with_depth) {
    std::vector<float> depth;
    for (std::size_t p = 0; p < with_depth.size(); ++p)
        depth.push_back(with_depth[p] ? 0.2f + std::cos(0.5f * static_cast<float>(p)) : 0);
    ImageGradients<Cpu> g;
    copy(depth, g.depth);
    return g;
}

class RayDepthBackward : public testing::TestWithParam<SurfaceDepth> {};

TEST_P(RayDepthBackward, AgainstDifferencesOfBruteForce) {
    auto g = random_gaussians(40, 8, 0.15);
    for (float& logit : g.opacity_logits.span()) logit += 1;
    const Camera camera = test_camera(32, 32);
    const auto backbone = backbone_with(GetParam());
    const auto& images = backbone->forward(g, camera, 3, kAll);
    Reference reference(g);
    const auto at = reference.render(camera);
    std::vector<char> with_depth;
    for (std::size_t p = 0; p < at.size(); ++p)
        // Between two surfaces the median moves fast, and ends of profiles matter.
        with_depth.push_back(images.depth[p] > 0 && at[p].T < 0.48 &&
                             (GetParam() != SurfaceDepth::median || at[p].slope < -0.5));
    ASSERT_GT(std::count(with_depth.begin(), with_depth.end(), 1), 150);
    const ImageGradients<Cpu> by = weights(with_depth);
    Gaussians<Cpu> dL;
    resize(dL, g.size(), 3);
    fill_zero(dL);
    backbone->backward(g, by, dL);

    const auto loss = [&] {
        double sum = 0;
        const auto pixels = reference.render(camera);
        for (std::size_t p = 0; p < pixels.size(); ++p)
            if (with_depth[p]) sum += static_cast<double>(by.depth[p]) * of(pixels[p], GetParam());
        return sum;
    };
    test::Differences differences(loss, 5e-3);
    for (std::size_t i = 0; i < 40; i += 2) {
        for (int axis = 0; axis < 3; ++axis) {
            differences.check(dL.means[i][axis], reference.means[i][axis], 3);
            differences.check(dL.log_scales[i][axis], reference.log_scales[i][axis], 0.3);
        }
        differences.check(dL.quats[i].w, reference.quats[i].w, 0.3);
        differences.check(dL.quats[i].x, reference.quats[i].x, 0.3);
        differences.check(dL.quats[i].y, reference.quats[i].y, 0.3);
        differences.check(dL.quats[i].z, reference.quats[i].z, 0.3);
        differences.check(dL.opacity_logits[i], reference.logits[i], 0.3);
    }
    // A cut-off crossed within 2h jumps the difference.
    std::printf("  %d of %d differ\n", differences.outliers, differences.checked);
    EXPECT_LE(differences.outliers, differences.checked / 20)
        << differences.outliers << " of " << differences.checked;
}

INSTANTIATE_TEST_SUITE_P(Kinds, RayDepthBackward, testing::ValuesIn(kKinds));

TEST(RayDepth, PlaneOfFlatSplatsHasItsDepth) {
    const Vec3f n = normalize(Vec3f{0.3f, -0.2f, -0.9f});
    const Vec3f a = normalize(cross(n, Vec3f{0, 1, 0})), b = cross(n, a);
    Camera camera = test_camera(80, 60);
    camera.camera_from_world = {};
    for (const float thin : {1e-4f, 1e-7f}) {
        test::Random random(9);
        Gaussians<Cpu> g = random_gaussians(600, 10);
        for (std::size_t i = 0; i < g.means.size(); ++i)
            test::lay_flat(
                g, i, -3 * n + float(random.uniform(-2, 2)) * a + float(random.uniform(-2, 2)) * b,
                n, {std::log(0.15f), std::log(0.1f), std::log(thin)}, random);
        for (const SurfaceDepth kind : kKinds)
            for (const PixelCenter center : {PixelCenter::exact, PixelCenter::official}) {
                const auto backbone = backbone_with(kind, center);
                const auto& images = backbone->forward(g, camera, 0, kGeometryMaps);
                int seen = 0;
                for (int y = 0; y < 60; ++y)
                    for (int x = 0; x < 80; ++x) {
                        const auto p = static_cast<std::size_t>(y * 80 + x);
                        if (images.transmittance[p] > 0.49f) continue;
                        ++seen;
                        const float exact = -3 / dot(n, pixel_ray(images.camera, x, y));
                        // The lower limit of the thickness, and flat splats above it.
                        ASSERT_NEAR(images.depth[p], exact, 1.5e-4f * exact) << x << ", " << y;
                    }
                EXPECT_GT(seen, 2000);
            }
    }
}

TEST(RayDepth, SphereOfSplatsHasItsDepth) {
    // Radius 1, seen from 4 units: the near side, although the far side shines through.
    test::Random random(4);
    Gaussians<Cpu> g = random_gaussians(6000, 3);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const Vec3f n = normalize(vec_cast<float>(random.normal3()));
        test::lay_flat(g, i, n, n, {std::log(0.05f), std::log(0.05f), std::log(1e-3f)}, random);
        g.opacity_logits[i] = 1;
    }
    Camera camera = test_camera(64, 64);
    camera.camera_from_world = {Mat3f{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, {0, 0, 4}};
    const auto backbone = backbone_with(SurfaceDepth::median);
    const auto& images = backbone->forward(g, camera, 0, kGeometryMaps);
    int seen = 0;
    double off = 0;
    for (int y = 0; y < 64; ++y)
        for (int x = 0; x < 64; ++x) {
            const Vec3d r = vec_cast<double>(pixel_ray(camera, x, y));
            const double rr = dot(r, r), root = 16 - rr * 15;
            if (root < 0.2) continue;  // the outline and its neighbourhood
            const double exact = (4 - std::sqrt(root)) / rr;
            const double d =
                static_cast<double>(images.depth[static_cast<std::size_t>(y * 64 + x)]);
            ASSERT_NEAR(d, exact, 0.05) << x << ", " << y;
            off += d - exact, ++seen;
        }
    EXPECT_GT(seen, 500);
    // Flat splats touch the sphere from outside: up to (2 x 0.05)^2 / 2, more when seen at an
    // angle.
    EXPECT_LT(off / seen, 0);
    EXPECT_GT(off / seen, -0.012);
}

TEST(RayDepth, EdgeOnSplatsStayWithinTheirSize) {
    // A disc seen edge on: its extent in depth equals its width, unlike a plane.
    Gaussians<Cpu> g = random_gaussians(1, 5);
    g.means[0] = {0, 0, 4}, g.quats[0] = {1, 0, 0, 0}, g.opacity_logits[0] = 4;
    g.log_scales[0] = {std::log(1e-6f), std::log(0.3f), std::log(0.3f)};
    Camera camera = test_camera(65, 65);
    camera.camera_from_world = {}, camera.cx_px = camera.cy_px = 32.5f;
    for (const SurfaceDepth kind : kKinds) {
        const auto backbone = backbone_with(kind);
        const auto& images = backbone->forward(g, camera, 0, kGeometryMaps);
        const float depth = images.depth[32 * 65 + 32];
        EXPECT_GT(depth, 3.2f);
        EXPECT_LT(depth, 4.01f);
    }
}

TEST(RayDepth, OtherMapsAreThePlanes) {
    const auto g = random_gaussians(300, 5, 0.1);
    const Camera camera = test_camera(50, 40);
    const auto plane = backbone_with(SurfaceDepth::plane);
    const auto& expected = plane->forward(g, camera, 3, kAll);
    for (const SurfaceDepth kind : kKinds) {
        const auto backbone = backbone_with(kind);
        const auto& images = backbone->forward(g, camera, 3, kAll);
        const auto same = [](const auto& x, const auto& y) {
            return x.size() == y.size() &&
                   std::memcmp(x.data(), y.data(), x.size() * sizeof(*x.data())) == 0;
        };
        EXPECT_TRUE(same(images.color, expected.color));
        EXPECT_TRUE(same(images.normal, expected.normal));
        EXPECT_TRUE(same(images.transmittance, expected.transmittance));
        EXPECT_FALSE(same(images.depth, expected.depth));

        // Without derivatives by depth the gradients are equal.
        ImageGradients<Cpu> by;
        copy(std::vector<Vec3f>(50 * 40, {1, 2, 3}), by.color);
        copy(std::vector<Vec3f>(50 * 40, {3, 1, 2}), by.normal);
        Gaussians<Cpu> here, there;
        for (auto* dL : {&here, &there}) resize(*dL, g.size(), 3), fill_zero(*dL);
        backbone->backward(g, by, here), plane->backward(g, by, there);
        EXPECT_TRUE(same(here.means, there.means));
        EXPECT_TRUE(same(here.quats, there.quats));
    }
}

TEST(RayDepth, HostileSplats) {
    Gaussians<Cpu> g = random_gaussians(200, 12, 0.1);
    for (std::size_t i = 0; i < 200; ++i) {
        const float sizes[] = {-1000, std::log(1e-7f), std::log(0.1f), std::log(1e3f), 20};
        for (int k = 0; k < 3; ++k)
            if (i % 3 == 0) g.log_scales[i][k] = sizes[(i / 3 + (k + 1) * (i % 7)) % 5];
    }
    g.means[0] = {NAN, 0, 0}, g.log_scales[1] = {NAN, 0, 0}, g.log_scales[2] = {80, 80, 80};
    g.quats[5] = {0, 0, 0, 0}, g.quats[7] = {1e-30f, 0, 0, 0};
    for (const std::size_t i : {10u, 11u, 12u}) g.opacity_logits[i] = 100;
    const Camera camera = test_camera(40, 40);
    for (const SurfaceDepth kind : kKinds) {
        const auto backbone = backbone_with(kind);
        const auto& images = backbone->forward(g, camera, 3, kAll);
        int seen = 0;
        for (const float depth : images.depth.span()) {
            ASSERT_TRUE(depth >= 0 && std::isfinite(depth)) << depth;
            seen += depth > 0;
        }
        EXPECT_GT(seen, 100);
        Gaussians<Cpu> dL;
        resize(dL, g.size(), 3);
        fill_zero(dL);
        backbone->backward(g, weights(std::vector<char>(1600, 1)), dL);
        for (std::size_t i = 0; i < 200; ++i) {
            EXPECT_TRUE(is_finite(dL.means[i])) << i;
            EXPECT_TRUE(is_finite(dL.log_scales[i])) << i;
            EXPECT_TRUE(std::isfinite(dL.quats[i].w + dL.quats[i].x + dL.quats[i].y)) << i;
            EXPECT_TRUE(std::isfinite(dL.opacity_logits[i])) << i;
        }
        EXPECT_EQ(norm(dL.means[0]), 0);
    }
}

TEST(RayDepth, NothingToSee) {
    Gaussians<Cpu> none;
    resize(none, 0, 3);
    for (const SurfaceDepth kind : kKinds) {
        const auto backbone = backbone_with(kind);
        const auto& images = backbone->forward(none, test_camera(20, 20), 3, kGeometryMaps);
        for (const float depth : images.depth.span()) EXPECT_EQ(depth, 0);
        Gaussians<Cpu> dL;
        resize(dL, 0, 3);
        backbone->backward(none, weights(std::vector<char>(400, 1)), dL);
    }
}

template <class Device>
struct Outcome {
    std::vector<float> depth, logits;
    std::vector<Vec3f> means, log_scales;
    std::vector<Quatf> quats;
    std::vector<Vec2f> screen;
};

template <class Device>
Outcome<Device> run(const Gaussians<Cpu>& host,
                    const Camera& camera,
                    SurfaceDepth kind,
                    Maps maps) {
    Gaussians<Device> g, dL;
    copy(host, g);
    const auto backbone = backbone_with<Device>(kind);
    const auto& images = backbone->forward(g, camera, 3, maps);
    resize(dL, g.size(), 3);
    fill_zero(dL);
    const ImageGradients<Cpu> by = weights(std::vector<char>(images.depth.size(), 1));
    ImageGradients<Device> there;
    copy(to_host(by.depth), there.depth);
    backbone->backward(g, there, dL);
    return {to_host(images.depth), to_host(dL.opacity_logits),
            to_host(dL.means),     to_host(dL.log_scales),
            to_host(dL.quats),     to_host(backbone->statistics().dL_dmeans2d)};
}

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

TEST(RayDepth, BitIdenticalForAnyNumberOfThreads) {
    const auto g = random_gaussians(500, 13);
    const int threads = thread_count();
    for (const SurfaceDepth kind : kKinds) {
        set_thread_count(1);
        const auto one = run<Cpu>(g, test_camera(64, 48), kind, kAll);
        set_thread_count(4);
        const auto four = run<Cpu>(g, test_camera(64, 48), kind, kAll);
        set_thread_count(threads);
        EXPECT_TRUE(same_bits(one.depth, four.depth));
        EXPECT_TRUE(same_bits(one.means, four.means));
    }
}

/// Shares of pixels or splats that differ: a pixel that reaches half of its light between two
/// surfaces, or a splat at its cut-off, may go either way. Below `least` is rounding.
template <class T>
void expect_few_differ(const char* name,
                       const std::vector<T>& a,
                       const std::vector<T>& b,
                       double relative,
                       double share,
                       double least = 1e-4) {
    constexpr std::size_t kNumbers = sizeof(T) / sizeof(float);
    const auto* const x = reinterpret_cast<const float*>(a.data());
    const auto* const y = reinterpret_cast<const float*>(b.data());
    std::vector<float> sizes;
    for (std::size_t i = 0; i < a.size() * kNumbers; ++i)
        if (x[i] != 0) sizes.push_back(std::abs(x[i]));
    ASSERT_EQ(a.size(), b.size());
    if (sizes.empty()) return;
    std::nth_element(sizes.begin(), sizes.begin() + std::ptrdiff_t(sizes.size() / 2), sizes.end());
    // The mean depth of a single splat does not depend on its opacity; the remainder is rounding.
    const double middle = std::max(static_cast<double>(sizes[sizes.size() / 2]), least);
    std::size_t differ = 0;
    for (std::size_t i = 0; i < a.size() * kNumbers; ++i) {
        const double here = static_cast<double>(x[i]), there = static_cast<double>(y[i]);
        differ += !(std::abs(here - there) <= relative * std::max(std::abs(here), middle));
    }
    std::printf("  %-10s %zu of %zu differ\n", name, differ, sizes.size());
    EXPECT_LE(static_cast<double>(differ), share * static_cast<double>(sizes.size()) + 1) << name;
}

TEST(RayDepthTwins, CpuAgainstCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        struct Case {
            int count;
            double size;
            int width, height;
            Maps maps;
        };
        for (const Case& c :
             {Case{0, 0.1, 50, 40, kAll}, Case{1, 0.1, 50, 40, kAll},
              Case{257, 0.1, 203, 151, kAll}, Case{257, 0.1, 203, 151, kGeometryMaps},
              Case{20000, 0.03, 203, 151, kAll}, Case{300, 3.0, 64, 64, kAll},
              Case{5000, 0.2, 16, 16, kAll}})
            for (const SurfaceDepth kind : kKinds) {
                const auto g = random_gaussians(c.count, 100 + unsigned(c.count), c.size);
                const Camera camera = test_camera(c.width, c.height);
                const auto cpu = run<Cpu>(g, camera, kind, c.maps);
                const auto cuda = run<Cuda>(g, camera, kind, c.maps),
                           again = run<Cuda>(g, camera, kind, c.maps);
                std::printf("  n %d, %s\n", c.count,
                            kind == SurfaceDepth::median ? "median" : "expected");
                // Close to half of the light the median of one device may be undefined.
                expect_few_differ("depth", cpu.depth, cuda.depth, 1e-3, 5e-3);
                expect_few_differ("means", cpu.means, cuda.means, 1e-2, 2e-2);
                expect_few_differ("scales", cpu.log_scales, cuda.log_scales, 1e-2, 2e-2);
                expect_few_differ("quats", cpu.quats, cuda.quats, 1e-2, 2e-2);
                expect_few_differ("logits", cpu.logits, cuda.logits, 1e-2, 2e-2);
                expect_few_differ("screen", cpu.screen, cuda.screen, 1e-2, 2e-2,
                                  // nor on the splat's place in the image
                                  c.count == 1 ? 0.1 : 1e-4);
                EXPECT_TRUE(same_bits(cuda.depth, again.depth)) << "not reproducible";
                EXPECT_TRUE(same_bits(cuda.means, again.means)) << "not reproducible";
            }
    }
}

}  // namespace
}  // namespace tvsgs
