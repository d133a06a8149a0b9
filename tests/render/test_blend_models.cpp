// Tests tile lists and blending with another model than EWA (disc_case.h): against a loop over all
// pixels and splats in double, and against central differences.
#include <algorithm>
#include <array>
#include <cstring>
#include <functional>
#include <numeric>

#include "disc_case.h"
#include "render/tiles/blend_cpu.h"
#include "render/tiles/tiles_cpu.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

using test::DiscCase;
using test::DiscGradients;
using test::DiscResult;
using test::kExtras;

/// A disc in double as a list of numbers, in the order of DiscGradients.
struct DiscD {
    Vec2<double> centre;
    double radius, opacity;
    Vec3d color;
    double depth;
    Vec2<double> slope;
    std::array<double, kExtras> extra;

    std::array<double*, 16> parameters() {
        return {&centre.x, &centre.y, &radius,   &opacity, &color.x,  &color.y,
                &color.z,  &depth,    &slope.x,  &slope.y, &extra[0], &extra[1],
                &extra[2], &extra[3], &extra[4], &extra[5]};
    }
};
std::array<float, 16> values(const DiscGradients& g) {
    const float* e = g.extra.of;
    return {g.centre.x, g.centre.y, g.radius, g.opacity, g.color.x, g.color.y, g.color.z, g.depth,
            g.slope.x,  g.slope.y,  e[0],     e[1],      e[2],      e[3],      e[4],      e[5]};
}

struct PixelD {
    double T = 1, depth = 0, spread = 0;
    Vec3d color{};
    std::array<double, kExtras> extra{};
};

/// All pixels, from the definition.
std::vector<PixelD> blended_plainly(int width,
                                    int height,
                                    const std::vector<DiscD>& discs,
                                    const std::vector<std::size_t>& front_to_back) {
    std::vector<PixelD> pixels;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            PixelD& pixel = pixels.emplace_back();
            std::vector<std::pair<double, double>> drawn;  // weight and depth
            for (const std::size_t i : front_to_back) {
                const DiscD& disc = discs[i];
                const double dx = x + 0.5 - disc.centre.x, dy = y + 0.5 - disc.centre.y;
                const double inside = 1 - (dx * dx + dy * dy) / (disc.radius * disc.radius);
                if (inside <= 0) continue;
                const double alpha = disc.opacity * inside * inside, w = alpha * pixel.T;
                if (pixel.T * (1 - alpha) < 1e-4) break;
                const double z = disc.depth + disc.slope.x * dx + disc.slope.y * dy;
                for (const auto& [other_w, other_z] : drawn)
                    pixel.spread += w * other_w * (z - other_z) * (z - other_z);
                drawn.emplace_back(w, z);
                pixel.color += w * disc.color;
                pixel.depth += w * z;
                for (std::size_t k = 0; k < kExtras; ++k) pixel.extra[k] += w * disc.extra[k];
                pixel.T *= 1 - alpha;
            }
        }
    return pixels;
}

struct Discs {
    DiscCase in;
    std::vector<DiscD> exact;
    std::vector<std::size_t> front_to_back;
};

/// Discs of any size up to the image's, and smooth gradients of the pixels.
Discs made_up(int count, int width, int height, double most_opaque, unsigned seed) {
    test::Random random(seed);
    const auto draw = [&](double low, double high) { return float(random.uniform(low, high)); };
    Discs d{{width, height, {}, {}, {}}, {}, {}};
    for (int i = 0; i < count; ++i) {
        const test::Disc disc{{draw(-10, width + 10), draw(-10, height + 10)},
                              std::exp(draw(std::log(2.0), std::log(0.7 * width))),
                              draw(0.05, most_opaque)};
        test::DiscFeatures f{vec_cast<float>(random.normal3()),
                             draw(2, 4),
                             {draw(-0.02, 0.02), draw(-0.02, 0.02)},
                             {}};
        for (float& extra : f.extra.of) extra = draw(-1, 1);
        d.in.discs.push_back(disc), d.in.features.push_back(f);
        DiscD exact{{disc.centre.x, disc.centre.y},
                    disc.radius,
                    disc.opacity,
                    vec_cast<double>(f.color),
                    f.depth,
                    {f.slope.x, f.slope.y},
                    {}};
        std::copy_n(f.extra.of, kExtras, exact.extra.begin());
        d.exact.push_back(exact);
    }
    for (int p = 0; p < width * height; ++p) {
        const float t = 0.01f * static_cast<float>(p);
        test::DiscModel::PixelGradient g;
        g.color = {std::sin(t), std::cos(2 * t), 0.5f};
        g.depth = 0.3f * std::cos(0.5f * t), g.spread = 0.2f + 0.1f * std::sin(3 * t);
        for (int k = 0; k < kExtras; ++k)
            g.extra.of[k] = 0.2f * std::sin(t + static_cast<float>(k));
        d.in.dL_dpixels.push_back(g);
    }
    d.front_to_back.resize(d.exact.size());
    std::iota(d.front_to_back.begin(), d.front_to_back.end(), std::size_t{0});
    std::stable_sort(
        d.front_to_back.begin(), d.front_to_back.end(),
        [&](std::size_t a, std::size_t b) { return d.exact[a].depth < d.exact[b].depth; });
    return d;
}

double loss(const DiscCase& in, const std::vector<PixelD>& pixels) {
    double sum = 0;
    for (std::size_t p = 0; p < pixels.size(); ++p) {
        const auto& g = in.dL_dpixels[p];
        sum += dot(vec_cast<double>(g.color), pixels[p].color) +
               static_cast<double>(g.depth) * pixels[p].depth +
               static_cast<double>(g.spread) * pixels[p].spread;
        for (std::size_t k = 0; k < kExtras; ++k)
            sum += static_cast<double>(g.extra.of[k]) * pixels[p].extra[k];
    }
    return sum;
}

using Blend = std::function<DiscResult(const DiscCase&)>;

void expect_images(const Blend& blend) {
    // Many opaque discs: pixels fill up before their lists end.
    const Discs d = made_up(600, 150, 101, 0.98, 3);
    const DiscResult out = blend(d.in);
    const auto expected = blended_plainly(150, 101, d.exact, d.front_to_back);
    int differ = 0, full = 0;
    for (std::size_t p = 0; p < expected.size(); ++p) {
        const PixelD& e = expected[p];
        double difference = 0;
        const auto off = [&](float value, double exact) {
            difference = std::max(difference, std::abs(static_cast<double>(value) - exact));
        };
        off(out.transmittance[p], e.T), off(out.depth[p], e.depth), off(out.spread[p], e.spread);
        for (int k = 0; k < 3; ++k) off(out.color[p][k], e.color[k]);
        for (std::size_t k = 0; k < kExtras; ++k) off(out.extra[p].of[k], e.extra[k]);
        differ += difference > 1e-5;  // sums of up to 20, in float
        full += e.T < 1e-3;
    }
    // In float a pixel may be full one disc earlier or later.
    EXPECT_LE(differ, 3);
    EXPECT_GT(full, 1000);
}

void expect_gradients(const Blend& blend) {
    // Up to 70 tiles each, so that warps share the sums of one splat.
    const Discs d = made_up(14, 150, 101, 0.6, 4);
    const DiscResult out = blend(d.in);
    ASSERT_EQ(out.gradients.size(), d.exact.size());
    std::array<double, 16> scale{};
    for (const auto& g : out.gradients)
        for (std::size_t k = 0; k < scale.size(); ++k)
            scale[k] = std::max(scale[k], std::abs(static_cast<double>(values(g)[k])));
    for (std::size_t i = 0; i < d.exact.size(); ++i) {
        const DiscGradients& g = out.gradients[i];
        EXPECT_GE(g.abs_centre.x, 0.9999f * std::abs(g.centre.x));
        EXPECT_GE(g.abs_centre.y, 0.9999f * std::abs(g.centre.y));
        auto discs = d.exact;
        const auto parameters = discs[i].parameters();
        const auto analytic = values(g);
        for (std::size_t k = 0; k < parameters.size(); ++k) {
            const double at = *parameters[k];
            const double expected = test::central_difference([&](double step) {
                *parameters[k] = at + step;
                return loss(d.in, blended_plainly(150, 101, discs, d.front_to_back));
            });
            *parameters[k] = at;
            // Sums of 15,000 floats of both signs.
            EXPECT_TRUE(
                test::close(static_cast<double>(analytic[k]), expected, 1e-3, 0.1 * scale[k]))
                << "disc " << i << ", value " << k;
        }
    }
}

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

TEST(BlendModels, DiscsAreAsDefined) {
    expect_images([](const DiscCase& in) { return test::blend_discs<Cpu>(in); });
}

TEST(BlendModels, DiscsHaveTheirGradients) {
    expect_gradients([](const DiscCase& in) { return test::blend_discs<Cpu>(in); });
}

TEST(BlendModelsTwin, Discs) {
    if (const std::string reason = test::no_cuda(); !reason.empty()) GTEST_SKIP() << reason;
    if constexpr (kHasCuda) {
        const Blend blend = test::blend_discs_cuda;
        expect_images(blend);
        expect_gradients(blend);
        for (const int count : {0, 1, 33, 3000}) {
            const DiscCase in = made_up(count, 203, 149, 0.9, 5).in;
            const DiscResult cpu = test::blend_discs<Cpu>(in), cuda = blend(in), again = blend(in);
            EXPECT_LE(relative_l2(cpu.color, cuda.color), 1e-4);
            EXPECT_LE(relative_l2(cpu.gradients, cuda.gradients), 2e-3);
            EXPECT_EQ(std::memcmp(cuda.gradients.data(), again.gradients.data(),
                                  cuda.gradients.size() * sizeof(DiscGradients)),
                      0)
                << "gradients are not reproducible";
        }
    }
}

}  // namespace
}  // namespace tvsgs
