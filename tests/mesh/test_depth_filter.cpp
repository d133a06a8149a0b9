// Depths by the planes of the pixels around: what is smoothed, and what is left alone.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <random>

#include "core/cuda_device.h"
#include "mesh/depth_clean.h"
#include "mesh/depth_filter.h"

namespace tvsgs {
namespace {

constexpr int kWidth = 48, kHeight = 36;
constexpr float kFocal = 32;

Camera camera() {
    return {kWidth, kHeight, kFocal, kFocal, 0.5f * kWidth, 0.5f * kHeight, {}};
}

/// A pixel's depth and normal by its ray (z = 1).
struct Seen {
    double depth;
    Vec3d normal;
};
using Scene = std::function<Seen(int x, int y, Vec3d ray)>;

Scene plane(double slope_x, double slope_y) {
    return [=](int, int, Vec3d ray) -> Seen {
        return {2 / (1 - slope_x * ray.x - slope_y * ray.y), {slope_x, slope_y, -1}};
    };
}

template <class Device>
std::vector<float> depths(const Scene& scene, int radius_px, DepthRules rules = {}) {
    const Camera view = camera();
    std::vector<float> depth;
    std::vector<Vec3f> normals;
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const Seen seen = scene(x, y, vec_cast<double>(pixel_ray(view, x, y)));
            depth.push_back(static_cast<float>(seen.depth));
            normals.push_back(vec_cast<float>(seen.normal));
        }
    RenderedImages<Device> images;
    copy(depth, images.depth), copy(normals, images.normal);
    copy(std::vector<float>(depth.size(), 0), images.transmittance);
    if (!(rules.depth_max > 0)) rules.depth_max = 100;
    rules.filter_px = radius_px;
    CleanDepth<Device> clean;
    clean_depth(images, view, {}, rules, clean);
    return to_host(clean.depth);
}

double rms(const std::vector<float>& a, const std::vector<float>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
        sum += std::pow(static_cast<double>(a[i]) - static_cast<double>(b[i]), 2);
    return std::sqrt(sum / static_cast<double>(a.size()));
}

/// The scene with noise on its depths, `sigma` pixels of it at depth 2.
Scene noisy(const Scene& scene, double sigma) {
    const auto random = std::make_shared<std::mt19937>(1);
    return [=](int x, int y, Vec3d ray) -> Seen {
        Seen seen = scene(x, y, ray);
        seen.depth += std::normal_distribution<double>(0, sigma * 2 / kFocal)(*random);
        return seen;
    };
}

TEST(DepthFilter, PlanesStayAndTheirNoiseGoes) {
    for (const auto& [slope_x, slope_y] : {std::pair(0.0, 0.0), {0.4, -0.3}, {-0.8, 0.1}}) {
        const Scene scene = plane(slope_x, slope_y);
        const std::vector<float> exact = depths<Cpu>(scene, 0);
        for (const int radius : {1, 3, kMostFilterPx}) {
            EXPECT_LT(rms(depths<Cpu>(scene, radius), exact), 1e-6) << slope_x << ' ' << radius;
            // Of n values the median has a spread of sqrt(pi / 2n); less of the window is left at
            // the image's border.
            const double before = rms(depths<Cpu>(noisy(scene, 0.5), 0), exact),
                         after = rms(depths<Cpu>(noisy(scene, 0.5), radius), exact),
                         edge = 2 * radius + 1;
            EXPECT_GT(before, 0.02);
            EXPECT_LT(after, 1.5 * std::sqrt(M_PI / 2) / edge * before) << slope_x << ' ' << radius;
        }
    }
}

TEST(DepthFilter, WhatIsFartherThanFourPixelsIsAnotherSurface) {
    // Steps, a thin rod, a lone pixel: at depth 2 four pixels are 0.25 wide, in the corners 0.34.
    for (const double gap : {0.24, 0.36}) {
        const auto before_wall = [&](int first, int last) {
            return [=](int x, int, Vec3d) -> Seen {
                return {x >= first && x <= last ? 2 - gap : 2.0, {0, 0, -1}};
            };
        };
        for (const auto& [first, last] : {std::pair(0, 20), {20, 21}, {20, 20}}) {
            const Scene scene = before_wall(first, last);
            const std::vector<float> given = depths<Cpu>(scene, 0),
                                     filtered = depths<Cpu>(scene, 5);
            if (gap > 0.3) {
                EXPECT_EQ(filtered, given) << first << ' ' << last;
            } else if (last - first < 5) {
                EXPECT_EQ(filtered[20], 2.0f) << first << ' ' << last;
            }
        }
    }
    // The wider of two pixels is the measure: a neighbour seen at a grazing angle reaches far.
    const auto beside = [](double slope) {
        return [=](int x, int y, Vec3d ray) -> Seen {
            if (x != 20 || y != 20) return {2.4, {0, 0, -1}};
            return {2, slope == 0 ? Vec3d{0, 0, -1} : Vec3d{slope, 0, -1 - slope * ray.x}};
        };
    };
    EXPECT_EQ(depths<Cpu>(beside(0), 5)[20 * kWidth + 20], 2.0f);
    EXPECT_EQ(depths<Cpu>(beside(3), 5)[20 * kWidth + 20], 2.4f);
    const Scene grazing = [](int x, int y, Vec3d ray) -> Seen {
        const Seen seen = plane(2, 0)(x, y, ray);
        return x == 24 && y == 20 ? Seen{seen.depth - 0.3, {0, 0, -1}} : seen;
    };
    const std::size_t i = 20 * kWidth + 24;
    EXPECT_NEAR(depths<Cpu>(grazing, 5)[i], depths<Cpu>(grazing, 0)[i] + 0.3f, 1e-5);
}

TEST(DepthFilter, ASphereIsOffByWhatItsPlanesAre) {
    // Planes lie before a sphere, by d^2 / 2r at a distance of d along it.
    const double r = 1;
    const Scene sphere = [=](int, int, Vec3d ray) -> Seen {
        const Vec3d centre{0, 0, 3};
        const double b = dot(ray, centre), a = dot(ray, ray),
                     root = b * b - a * (dot(centre, centre) - r * r);
        if (root < 0.2) return {0, {0, 0, -1}};  // away from the outline
        const double s = (b - std::sqrt(root)) / a;
        return {s, s * ray - centre};
    };
    const std::vector<float> exact = depths<Cpu>(sphere, 0);
    for (const int radius : {1, 5}) {
        const std::vector<float> filtered = depths<Cpu>(sphere, radius);
        int seen = 0;
        for (std::size_t i = 0; i < exact.size(); ++i) {
            if (!(exact[i] > 0)) {
                EXPECT_EQ(filtered[i], 0);
                continue;
            }
            ++seen;
            const double most = std::sqrt(2.0) * radius * 3 / static_cast<double>(kFocal);
            EXPECT_LE(filtered[i], exact[i] + 0.3 * most * most) << i;
            EXPECT_GE(filtered[i], exact[i] - 3 * most * most / (2 * r)) << i;
        }
        EXPECT_GT(seen, 150);
    }
}

TEST(DepthFilter, TheWindowIsTheSameToAllSides) {
    // A row, or a column, between others: six of nine values are theirs.
    for (const bool columns : {false, true})
        for (const double around : {1.98, 2.02}) {
            const Scene stripe = [=](int x, int y, Vec3d) -> Seen {
                return {(columns ? x : y) == 18 ? 2 : around, {0, 0, 0}};
            };
            EXPECT_EQ(depths<Cpu>(stripe, 1)[18 * kWidth + 18], static_cast<float>(around));
        }
}

TEST(DepthFilter, WhatIsDroppedSaysNothingAndStaysSo) {
    // Columns below 10 lie behind the limit, and a hole has no depth.
    const Scene scene = [](int x, int y, Vec3d) -> Seen {
        if (x == 30 && y == 20) return {0, {0, 0, -1}};
        return {x < 10 ? 2.1 : 2 + 0.02 * (x % 2), {0, 0, -1}};
    };
    DepthRules rules;
    rules.depth_max = 2.05f;
    const std::vector<float> filtered = depths<Cpu>(scene, 5, rules);
    EXPECT_EQ(filtered[20 * kWidth + 9], 0);
    EXPECT_EQ(filtered[20 * kWidth + 30], 0);
    const Scene without = [&](int x, int y, Vec3d ray) -> Seen {
        return {x < 10 ? 0 : scene(x, y, ray).depth, {0, 0, -1}};
    };
    EXPECT_EQ(filtered, depths<Cpu>(without, 5));
    EXPECT_NE(filtered, depths<Cpu>(scene, 5)) << "it would say something";
    // What is filtered is rounded down to steps.
    rules = {};
    rules.depth_step = 0.25f;
    for (const float depth : depths<Cpu>(scene, 5, rules))
        EXPECT_EQ(depth, depth > 0 ? 2.0f : 0.0f);
    // What a rule would drop keeps its own depth: in front of the box, by what most others say.
    rules = {};
    rules.has_box = true, rules.box_min = {-9, -9, 2.005f}, rules.box_max = {9, 9, 9};
    const Scene few = [](int x, int, Vec3d) -> Seen {
        return {x == 24 ? 2.01 : x % 2 ? 2.006 : 2.05, {0, 0, -1}};
    };
    const Scene tilted = [&](int x, int y, Vec3d ray) -> Seen {
        Seen seen = few(x, y, ray);
        if (x != 24) seen.normal = {0.3, 0, -1};  // they say that it lies nearer, or farther
        return seen;
    };
    for (const float depth : depths<Cpu>(tilted, 5, rules)) EXPECT_GE(depth, 2.005f);
    // Without a normal a pixel reaches so far that no depth at all would count, as 0: around column
    // 26 four of eleven columns have none, four have 2.1.
    const Scene holes = [](int x, int, Vec3d) -> Seen {
        return {x % 3 == 0 ? 0 : x % 3 == 1 ? 2.1 : 2.0, {0, 0, 0}};
    };
    EXPECT_EQ(depths<Cpu>(holes, 5)[18 * kWidth + 26], 2.1f);
    // No normals: a depth is what its neighbours have.
    const Scene bare = [](int x, int y, Vec3d) -> Seen {
        return {x == 24 && y == 18 ? 2.1 : 2.0, {0, 0, 0}};
    };
    EXPECT_EQ(depths<Cpu>(bare, 2)[18 * kWidth + 24], 2.0f);
}

TEST(DepthFilter, RanksAreThoseOfASort) {
    std::mt19937 random(3);
    for (int n = 1; n < 60; ++n)
        for (const int kinds : {1, 2, 5, 1000}) {
            std::vector<float> values;
            for (int i = 0; i < n; ++i)
                values.push_back(static_cast<float>(static_cast<int>(random() % 1000) % kinds));
            std::vector<float> sorted = values;
            std::sort(sorted.begin(), sorted.end());
            for (int rank = 0; rank < n; ++rank) {
                std::vector<float> moved = values;
                ASSERT_EQ(ranked(moved.data(), n, rank), sorted[static_cast<std::size_t>(rank)])
                    << n << ' ' << kinds << ' ' << rank;
            }
        }
}

TEST(DepthFilterTwin, SameBitsOnBothDevices) {
    if constexpr (kHasCuda) {
        if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
        for (const int radius : {1, 5}) {
            const Scene step = [](int x, int y, Vec3d ray) {
                Seen seen = plane(0.4, -0.3)(x, y, ray);
                if (x < 20) seen.depth -= 0.5;
                if (x == 3) seen.depth = 0;
                return seen;
            };
            EXPECT_EQ(depths<Cpu>(noisy(step, 1), radius), depths<Cuda>(noisy(step, 1), radius));
        }
    } else {
        GTEST_SKIP() << "build without CUDA";
    }
}

}  // namespace
}  // namespace tvsgs
