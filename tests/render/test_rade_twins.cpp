// Tests the backbone `rade` on a GPU against the CPU, for every map.
#include <gtest/gtest.h>

#include <cmath>

#include "rade_case.h"

namespace tvsgs {
namespace {

using test::random_gaussians;
using test::test_camera;
using test::with_depth;

constexpr Maps kAll = test::kAllRadeMaps;

template <class T>
void expect_same(const std::vector<T>& a, const std::vector<T>& b, double bound, const char* what) {
    ASSERT_EQ(a.size(), b.size()) << what;
    double off = 0, total = 1e-12;
    const auto* const p = reinterpret_cast<const float*>(a.data());
    const auto* const q = reinterpret_cast<const float*>(b.data());
    for (std::size_t i = 0; i < a.size() * sizeof(T) / sizeof(float); ++i)
        off += std::pow(p[i] - q[i], 2), total += std::pow(p[i], 2);
    EXPECT_LT(std::sqrt(off / total), bound) << what;
}

/// Allows one splat in two hundred to differ by more than a thousandth of the median size.
template <class T>
void expect_few_differ(const std::vector<T>& a, const std::vector<T>& b, const char* what) {
    constexpr std::size_t kFloats = sizeof(T) / sizeof(float);
    const auto length = [](const float* v) {
        double sum = 0;
        for (std::size_t k = 0; k < kFloats; ++k) sum += double{v[k]} * v[k];
        return std::sqrt(sum);
    };
    std::vector<double> sizes;
    for (const T& value : a)
        if (const double size = length(reinterpret_cast<const float*>(&value)); size > 0)
            sizes.push_back(size);
    ASSERT_GT(sizes.size(), a.size() / 4) << what;
    const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
    std::nth_element(sizes.begin(), middle, sizes.end());
    std::size_t differ = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        const auto* const p = reinterpret_cast<const float*>(&a[i]);
        const auto* const q = reinterpret_cast<const float*>(&b[i]);
        float difference[kFloats];
        for (std::size_t k = 0; k < kFloats; ++k) difference[k] = p[k] - q[k];
        differ += length(difference) > 1e-3 * std::max(length(p), *middle);
    }
    EXPECT_LE(differ, sizes.size() / 200) << what << ": " << differ << " of " << sizes.size();
}

TEST(RadeTwins, CpuAgainstCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const Camera camera = test_camera(90, 70);
        auto g = random_gaussians(2000, 7, 0.1);
        Gaussians<Cuda> there;
        copy(g, there);
        make_backbone<Cpu>("rade", {})->prepare(0, true, {camera, test_camera(80, 70, -0.2f)}, g);
        make_backbone<Cuda>("rade", {})
            ->prepare(0, true, {camera, test_camera(80, 70, -0.2f)}, there);
        expect_same(to_host(g.filter), to_host(there.filter), 1e-6, "filter");
        for (std::size_t i = 0; i < g.means.size(); ++i) g.filter[i] *= 4;  // a visible effect
        copy(g, there);
        const ImageGradients<Cpu> by = test::weights_of_maps(90 * 70);
        ImageGradients<Cuda> by_there;
        copy(to_host(by.color), by_there.color), copy(to_host(by.normal), by_there.normal);
        copy(to_host(by.depth), by_there.depth);
        copy(to_host(by.expected_depth), by_there.expected_depth);
        for (const SurfaceDepth depth : {SurfaceDepth::expected, SurfaceDepth::median})
            for (const Maps maps : {Maps::color, kGeometryMaps | Maps::expected_depth, kAll}) {
                const auto cpu = make_backbone<Cpu>("rade", with_depth(depth));
                const auto cuda = make_backbone<Cuda>("rade", with_depth(depth));
                const auto& a = cpu->forward(g, camera, 3, maps);
                const auto& b = cuda->forward(there, camera, 3, maps);
                expect_same(to_host(a.transmittance), to_host(b.transmittance), 1e-4, "T");
                expect_same(to_host(a.color), to_host(b.color), 1e-4, "colour");
                expect_same(to_host(a.normal), to_host(b.normal), 2e-3, "normal");
                expect_same(to_host(a.depth), to_host(b.depth), 2e-2, "depth");  // medians jump
                expect_same(to_host(a.expected_depth), to_host(b.expected_depth), 2e-3, "mean");
                expect_same(to_host(cpu->statistics().radii_px),
                            to_host(cuda->statistics().radii_px), 1e-2, "radii");
                Gaussians<Cpu> dL, dL_host;
                Gaussians<Cuda> dL_there;
                resize(dL, g.size(), 3), fill_zero(dL);
                resize(dL_there, g.size(), 3), fill_zero(dL_there);
                cpu->backward(g, by, dL);
                cuda->backward(there, by_there, dL_there);
                copy(dL_there, dL_host);
                // A splat at its cut-off, or a median that moves to another splat, changes a
                // pixel's gradient. So the sums may differ, but only of few splats.
                expect_few_differ(to_host(dL.means), to_host(dL_host.means), "means");
                expect_few_differ(to_host(dL.log_scales), to_host(dL_host.log_scales), "scales");
                expect_few_differ(to_host(dL.quats), to_host(dL_host.quats), "quats");
                expect_few_differ(to_host(dL.opacity_logits), to_host(dL_host.opacity_logits),
                                  "opacities");
                expect_same(to_host(dL.sh), to_host(dL_host.sh), 1e-3, "sh");
                const auto& of_cpu = cpu->statistics();
                const auto& of_cuda = cuda->statistics();
                expect_few_differ(to_host(of_cpu.dL_dmeans2d), to_host(of_cuda.dL_dmeans2d),
                                  "statistics");
                expect_few_differ(to_host(of_cpu.abs_dL_dmeans2d), to_host(of_cuda.abs_dL_dmeans2d),
                                  "absolute statistics");
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
