// Tests which splats are too large to be meshed.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/device/cuda_device.h"
#include "mesh/fuse/large_splats.h"

namespace tvsgs {
namespace {

Camera camera_at(float x, float f_px, float cx_px = 32) {
    Camera camera{64, 48, f_px, f_px, cx_px, 24, {}};
    camera.camera_from_world.R = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    camera.camera_from_world.t = {-x, 0, 0};
    return camera;
}

/// Splats at (0, 0, z) with standard deviations of 4 pixels, times `largest` on one axis.
Gaussians<Cpu> splats(const std::vector<float>& z, const std::vector<float>& largest, int axis) {
    Gaussians<Cpu> g;
    resize(g, static_cast<int>(z.size()), 0);
    for (std::size_t i = 0; i < z.size(); ++i) {
        g.means[i] = {0, 0, z[i]};
        g.log_scales[i] = {-6, -6, -6};
        g.log_scales[i][axis] = std::log(largest[i]);
        g.opacity_logits[i] = 2;
    }
    return g;
}

const std::vector<Camera> kCameras{camera_at(0, 100), camera_at(3, 400, 332)};

TEST(LargeSplats, AreThoseAboveSoManyPixelsOfTheFinestCamera) {
    // Pixel widths at (0, 0, 4): 0.04 in the first camera, 0.0125 in the second, which is 5 away.
    // At (0, 0, 0.3): 0.003 and 0.00754.
    for (int axis = 0; axis < 3; ++axis) {
        Gaussians<Cpu> g = splats({4, 4, 0.3f, 0.3f}, {0.0999f, 0.1001f, 0.0239f, 0.0241f}, axis);
        EXPECT_EQ(fade_large(kCameras, 8, g), 2u);
        for (const auto& [i, stays] : {std::pair(0, true), {1, false}, {2, true}, {3, false}})
            EXPECT_EQ(g.opacity_logits[static_cast<std::size_t>(i)], stays ? 2.0f : kFaded) << i;
    }
}

TEST(LargeSplats, CamerasThatDoNotSeeThePlaceDoNotCount) {
    // The second camera has finer pixels there, but the point is outside of its image.
    std::vector<Camera> cameras{camera_at(0, 100), camera_at(1, 400)};
    Gaussians<Cpu> g = splats({0.9f, 0.9f}, {0.07f, 0.074f}, 0);  // 8 x 0.009 = 0.072
    fade_large(cameras, 8, g);
    EXPECT_EQ(g.opacity_logits[0], 2);
    EXPECT_EQ(g.opacity_logits[1], kFaded);
}

TEST(LargeSplats, WhatIsNotFiniteGoes) {
    const float bad = std::numeric_limits<float>::quiet_NaN();
    Gaussians<Cpu> g = splats({4, bad}, {bad, 0.01f}, 1);
    fade_large(kCameras, 8, g);
    EXPECT_EQ(g.opacity_logits[0], kFaded);
}

TEST(UnsupportedSplats, BecomeInvisible) {
    Gaussians<Cpu> g = splats({4, 4, 4}, {0.01f, 0.01f, 0.01f}, 0);
    EXPECT_EQ(fade_unsupported(g), 0u) << "no splat has an uncertainty";
    EXPECT_EQ(g.opacity_logits[0], 2);
    copy(std::vector<float>{0, 0.1f, 0}, g.uncertainty);
    EXPECT_EQ(fade_unsupported(g), 2u);
    EXPECT_EQ(g.opacity_logits[0], kFaded);
    EXPECT_EQ(g.opacity_logits[1], 2);
}

TEST(LargeSplats, TwinsAgree) {
    if constexpr (kHasCuda) {
        if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
        std::vector<float> z, largest;
        for (int i = 0; i < 500; ++i) {
            z.push_back(1 + 0.01f * static_cast<float>(i));
            largest.push_back(0.02f + 0.0004f * static_cast<float>(i * 7 % 500));
        }
        Gaussians<Cpu> cpu = splats(z, largest, 2);
        Gaussians<Cuda> cuda;
        copy(cpu, cuda);
        fade_large(kCameras, 8, cpu);
        fade_large(kCameras, 8, cuda);
        const std::vector<float> a = to_host(cpu.opacity_logits), b = to_host(cuda.opacity_logits);
        EXPECT_EQ(a, b);
        EXPECT_GT(std::count(a.begin(), a.end(), 2.0f), 50);
        EXPECT_GT(std::count(a.begin(), a.end(), kFaded), 50);
    } else {
        GTEST_SKIP() << "build without CUDA";
    }
}

}  // namespace
}  // namespace tvsgs
