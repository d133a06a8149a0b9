// The fused step gives the same bits as the plain step, for every rasteriser and set of maps.
#include <algorithm>
#include <cstring>
#include <functional>
#include <sstream>

#include "core/error.h"
#include "optim/optimiser/adam.h"
#include "render/backbone.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using test::close;

/// Three cameras; none sees all splats.
Camera narrow_camera(int view) {
    Camera c = test::test_camera(24, 16, 0.5f * static_cast<float>(view));
    c.fx_px *= 3, c.fy_px *= 3;
    return c;
}

std::vector<Camera> narrow_cameras() {
    return {narrow_camera(0), narrow_camera(1), narrow_camera(2)};
}

/// State after steps along given image gradients.
struct Stepped {
    Gaussians<Cpu> g, m, v;
    std::vector<Vec2f> by_ndc, abs_by_ndc;  // statistics of the last step
    std::vector<int> front;
    std::vector<float> radii_px;
};

enum class Way { in_memory, fused };

/// A rasteriser, the maps that it renders, and its kind of depth.
struct Drawn {
    std::string backbone;
    SurfaceDepth depth;
    Maps maps;
};
std::string text(const Drawn& d) {
    return d.backbone + ", depth " + std::to_string(static_cast<int>(d.depth)) + ": " +
           names_of(d.maps);
}

/// All combinations of our rasterisers.
std::vector<Drawn> all_drawn() {
    std::vector<Drawn> all;
    std::istringstream names(backbones_of(true) + ", " + backbones_of(false));
    for (std::string name; names >> name;) {
        if (name.back() == ',') name.pop_back();
        const Maps maps = make_backbone<Cpu>(name, {})->traits.maps;
        all.push_back({name, SurfaceDepth::automatic, Maps::color});
        for (const SurfaceDepth depth :
             {SurfaceDepth::plane, SurfaceDepth::expected, SurfaceDepth::median})
            try {
                BackboneOptions options;
                options.depth = depth;
                make_backbone<Cpu>(name, options);
                all.push_back({name, depth, maps});
                all.push_back({name, depth, without(maps, Maps::color)});
            } catch (const Error& refused) {
                EXPECT_EQ(refused.code(), ExitCode::usage);
            }
    }
    EXPECT_GE(all.size(), 13u);  // three rasterisers, one or two depths each
    return all;
}

/// Random gradients of the rendered `maps`.
template <class Device>
ImageGradients<Device> noise_for(const RenderedImages<Device>& images, Maps maps, unsigned seed) {
    ImageGradients<Device> dL;
    const auto vectors = [&](Maps map, const auto& image, auto& gradient) {
        if (!has(maps, map)) return;
        test::Random random(seed);
        std::vector<Vec3f> noise(image.size());
        for (Vec3f& p : noise) p = vec_cast<float>(random.normal3());
        copy(noise, gradient);
    };
    const auto numbers = [&](Maps map, const auto& image, auto& gradient) {
        if (has(maps, map)) copy(std::vector<float>(image.size(), 2), gradient);
    };
    vectors(Maps::color, images.color, dL.color);
    vectors(Maps::normal, images.normal, dL.normal);
    numbers(Maps::depth, images.depth, dL.depth);
    numbers(Maps::distortion, images.distortion, dL.distortion);
    numbers(Maps::expected_depth, images.expected_depth, dL.expected_depth);
    return dL;
}

/// Steps through the views. `without_map`: this map has no gradient.
template <class Device>
Stepped step_views(
    Way way, int steps, const Drawn& drawn, bool with_extra = true, Maps without_map = Maps::none) {
    Gaussians<Device> g, extra, gradients;
    copy(test::random_gaussians(120, 7, 0.05), g);
    BackboneOptions render;
    render.depth = drawn.depth;
    const auto backbone = make_backbone<Device>(drawn.backbone, render);
    backbone->prepare(0, true, narrow_cameras(), g);
    AdamOptions options;
    options.scale = 1e-4f;  // noise as gradients: splats must not grow over the image
    Adam<Device> adam(options, g);
    for (int t = 1; t <= steps; ++t) {
        const int degree = std::min(3, t / 8);
        if (with_extra) {
            Gaussians<Cpu> host = test::random_gaussians(120, 100 + static_cast<unsigned>(t));
            host.sh.resize(0);
            copy(host, extra);
        }
        const auto dL_dimages =
            noise_for(backbone->forward(g, narrow_camera(t % 3), degree, drawn.maps),
                      without(drawn.maps, without_map), static_cast<unsigned>(t));
        if (way != Way::in_memory) {
            adam.step(t, 1, degree, *backbone->blend_backward(g, dL_dimages), extra, g, true);
        } else {
            resize(gradients, g.size(), 3);
            fill_zero(gradients);
            if (with_extra) {
                copy(extra.means, gradients.means), copy(extra.log_scales, gradients.log_scales);
                copy(extra.quats, gradients.quats);
                copy(extra.opacity_logits, gradients.opacity_logits);
            }
            backbone->backward(g, dL_dimages, gradients);
            adam.step(t, 1, degree, gradients, g, true);
        }
        backbone->prepare(t, false, narrow_cameras(), g);
    }
    Stepped out;
    copy(g, out.g), copy(adam.first_moments(), out.m), copy(adam.second_moments(), out.v);
    const ScreenStatistics<Device>& seen = backbone->statistics();
    out.by_ndc = to_host(seen.dL_dmeans2d), out.abs_by_ndc = to_host(seen.abs_dL_dmeans2d);
    out.front = to_host(seen.front_pixels), out.radii_px = to_host(seen.radii_px);
    return out;
}

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}
template <class T>
bool same_bits(const Buffer<T, Cpu>& a, const Buffer<T, Cpu>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}
bool same_bits(const Gaussians<Cpu>& a, const Gaussians<Cpu>& b) {
    return same_bits(a.means, b.means) && same_bits(a.log_scales, b.log_scales) &&
           same_bits(a.quats, b.quats) && same_bits(a.opacity_logits, b.opacity_logits) &&
           same_bits(a.sh, b.sh);
}
bool same_bits(const Stepped& a, const Stepped& b) {
    return same_bits(a.g, b.g) && same_bits(a.m, b.m) && same_bits(a.v, b.v) &&
           same_bits(a.by_ndc, b.by_ndc) && same_bits(a.abs_by_ndc, b.abs_by_ndc) &&
           same_bits(a.front, b.front);
}

TEST(FusedStep, WithoutGradientsInMemoryTheBitsAreTheSame) {
#if defined(__FMA__)
    GTEST_SKIP() << "built for a processor on which the compiler fuses as it likes";
#endif
    for (const Drawn& drawn : all_drawn())
        EXPECT_TRUE(same_bits(step_views<Cpu>(Way::in_memory, 40, drawn),
                              step_views<Cpu>(Way::fused, 40, drawn)))
            << text(drawn);
}

TEST(FusedStep, SupportedSplatsHaveTheSameRatesInMemory) {
#if defined(__FMA__)
    GTEST_SKIP() << "built for a processor on which the compiler fuses as it likes";
#endif
    for (const char* name : {"ewa", "surfel"}) {
        Gaussians<Cpu> fused = test::random_gaussians(200, 3, 0.1), in_memory, plain;
        fused.uncertainty.resize(200);
        for (std::size_t i = 0; i < 200; ++i) fused.uncertainty[i] = i % 2 == 0 ? 0 : 0.2f;
        copy(fused, in_memory), copy(fused, plain);
        AdamOptions options;
        options.supported = 0.5f;
        const auto backbone = make_backbone<Cpu>(name, {});
        ImageGradients<Cpu> by;
        copy(std::vector<Vec3f>(40 * 30, {0.3f, -0.2f, 0.1f}), by.color);
        backbone->forward(fused, test::test_camera(40, 30), 3, Maps::color);
        Gaussians<Cpu> dL, none;
        resize(dL, 200, 3), fill_zero(dL);
        backbone->backward(fused, by, dL);
        Adam<Cpu>(options, in_memory).step(1, 2, 3, dL, in_memory, true);
        Adam<Cpu>(AdamOptions{}, plain).step(1, 2, 3, dL, plain, true);
        Adam<Cpu>(options, fused)
            .step(1, 2, 3, *backbone->blend_backward(fused, by), none, fused, true);
        EXPECT_TRUE(same_bits(fused, in_memory)) << name;
        EXPECT_FALSE(same_bits(fused.means, plain.means)) << name;
    }
}

TEST(FusedStep, EachMapHasItsShare) {
    for (const Drawn& drawn : all_drawn()) {
        const Stepped all = step_views<Cpu>(Way::fused, 1, drawn, false);
        for (const Maps map :
             {Maps::color, Maps::normal, Maps::depth, Maps::distortion, Maps::expected_depth}) {
            if (!has(drawn.maps, map)) continue;
            const Stepped less = step_views<Cpu>(Way::fused, 1, drawn, false, map);
            EXPECT_FALSE(same_bits(all.m, less.m)) << text(drawn) << " without " << names_of(map);
        }
    }
}

TEST(FusedStep, SplatsOutOfViewGoOnByTheirMoments) {
    for (const Drawn& drawn : all_drawn()) {
        const Stepped one = step_views<Cpu>(Way::fused, 1, drawn, false),
                      two = step_views<Cpu>(Way::fused, 2, drawn, false);
        int alone = 0;
        for (std::size_t i = 0; i < 120; ++i) {
            const Vec3f m = one.m.means[i];
            if (two.radii_px[i] > 0 || !(norm(m) > 0)) continue;
            ++alone;
            EXPECT_EQ(two.m.means[i].x, 0.9f * m.x) << text(drawn) << ", " << i;
            EXPECT_EQ(two.m.sh[i].y, 0.9f * one.m.sh[i].y) << text(drawn) << ", " << i;
            EXPECT_NE(two.g.means[i].x, one.g.means[i].x) << text(drawn) << ", " << i;
        }
        EXPECT_GT(alone, 1) << text(drawn);
    }
}

TEST(FusedStep, TheThicknessOfADiscHasNoGradient) {
    for (const Drawn& drawn : all_drawn()) {
        if (!make_backbone<Cpu>(drawn.backbone, {})->traits.flat) continue;
        const Stepped stepped = step_views<Cpu>(Way::fused, 3, drawn, false);
        for (std::size_t i = 0; i < 120; ++i)
            EXPECT_EQ(stepped.m.log_scales[i].z, 0) << text(drawn) << ", " << i;
    }
}

TEST(FusedStep, StatisticsAloneAreThoseOfTheStep) {
    for (const Drawn& drawn : all_drawn()) {
        Gaussians<Cpu> g = test::random_gaussians(120, 7, 0.05);
        BackboneOptions render;
        render.depth = drawn.depth;
        const auto backbone = make_backbone<Cpu>(drawn.backbone, render);
        backbone->prepare(0, true, narrow_cameras(), g);
        const auto dL_dimages =
            noise_for(backbone->forward(g, narrow_camera(1), 0, drawn.maps), drawn.maps, 1);
        write_statistics(Cpu{}, *backbone->blend_backward(g, dL_dimages));
        const auto& alone = backbone->statistics();
        const Stepped stepped = step_views<Cpu>(Way::fused, 1, drawn);
        EXPECT_TRUE(same_bits(to_host(alone.dL_dmeans2d), stepped.by_ndc)) << text(drawn);
        EXPECT_TRUE(same_bits(to_host(alone.abs_dL_dmeans2d), stepped.abs_by_ndc)) << text(drawn);
        EXPECT_TRUE(same_bits(to_host(alone.front_pixels), stepped.front)) << text(drawn);
        backbone->observe(g);
        EXPECT_TRUE(same_bits(to_host(alone.front_pixels), stepped.front)) << text(drawn);
        for (const Vec2f by : to_host(alone.dL_dmeans2d)) EXPECT_EQ(dot(by, by), 0) << text(drawn);
    }
}

TEST(FusedStep, AHaltedStepChangesNothing) {
    for (const Drawn& drawn : all_drawn()) {
        Gaussians<Cpu> g = test::random_gaussians(50, 7, 0.05), none, before;
        copy(g, before);
        BackboneOptions render;
        render.depth = drawn.depth;
        const auto backbone = make_backbone<Cpu>(drawn.backbone, render);
        Adam<Cpu> adam({}, g);
        const auto dL_dimages =
            noise_for(backbone->forward(g, narrow_camera(0), 3, drawn.maps), drawn.maps, 1);
        const int halted = 1;
        adam.step(1, 1, 3, *backbone->blend_backward(g, dL_dimages), none, g, true, &halted);
        EXPECT_TRUE(same_bits(g, before)) << text(drawn);
    }
}

/// All but a few first moments agree to a thousandth of their median magnitude.
template <class T>
void expect_few_differ(const Buffer<T, Cpu>& a, const Buffer<T, Cpu>& b, const std::string& what) {
    ASSERT_EQ(a.size(), b.size()) << what;
    const std::size_t count = a.size() * sizeof(T) / sizeof(float);
    const auto* const p = reinterpret_cast<const float*>(a.data());
    const auto* const q = reinterpret_cast<const float*>(b.data());
    std::vector<float> sizes;
    for (std::size_t i = 0; i < count; ++i)
        if (p[i] != 0) sizes.push_back(std::abs(p[i]));
    if (sizes.empty()) {
        EXPECT_TRUE(same_bits(a, b)) << what;
        return;
    }
    const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
    std::nth_element(sizes.begin(), middle, sizes.end());
    std::size_t differ = 0;
    for (std::size_t i = 0; i < count; ++i)
        differ += !close(double{p[i]}, double{q[i]}, 1e-3, double{*middle});
    EXPECT_LE(differ, 1 + sizes.size() / 50) << what << ": " << differ << " of " << sizes.size();
}
void expect_few_differ(const Stepped& a, const Stepped& b, const std::string& what) {
    expect_few_differ(a.m.means, b.m.means, what + ", means");
    expect_few_differ(a.m.log_scales, b.m.log_scales, what + ", scales");
    expect_few_differ(a.m.quats, b.m.quats, what + ", quats");
    expect_few_differ(a.m.opacity_logits, b.m.opacity_logits, what + ", opacities");
    expect_few_differ(a.m.sh, b.m.sh, what + ", sh");
}

/// A single step from the same start: later steps diverge, as Adam takes full steps even along
/// rounding errors.
TEST(AdamTwins, CpuAgainstCuda) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        const Drawn colors{"ewa", SurfaceDepth::automatic, Maps::color};
        const Stepped a = step_views<Cpu>(Way::fused, 1, colors, false),
                      b = step_views<Cuda>(Way::fused, 1, colors, false);
        for (std::size_t i = 0; i < 120; ++i) {
            // Gradients are sums over pixels whose alphas differ by a relative 1e-6.
            EXPECT_TRUE(close(a.m.means[i].x, b.m.means[i].x, 1e-3, 1e-4)) << i;
            EXPECT_TRUE(close(a.m.opacity_logits[i], b.m.opacity_logits[i], 1e-3, 1e-4)) << i;
            EXPECT_TRUE(close(a.m.sh[i].y, b.m.sh[i].y, 1e-3, 1e-4)) << i;
            EXPECT_NEAR(std::abs(a.g.sh[i].y), std::abs(b.g.sh[i].y), 5.1e-3) << i;
        }
    }
}

/// The sums over pixels have the same bits in both modes; the compiler rounds later operations
/// differently. The second step has splats out of view, and gradients of losses.
TEST(AdamTwins, FusedOnAGpuIsAsInMemory) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        for (const Drawn& drawn : all_drawn())
            for (const int steps : {1, 2})
                expect_few_differ(step_views<Cuda>(Way::in_memory, steps, drawn, steps == 2),
                                  step_views<Cuda>(Way::fused, steps, drawn, steps == 2),
                                  text(drawn));
    }
}

}  // namespace
}  // namespace tvsgs
