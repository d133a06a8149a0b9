// Clouds, and voting events with results on the host, for the tests of tensor voting.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include "apps/bench/field.h"
#include "core/device/cuda_device.h"
#include "core/scene/gaussians.h"
#include "tv/vote_math.h"
#include "tv/voting.h"

namespace tvsgs::test {

inline double angle_deg(Vec3f a, Vec3f b) {
    return tvsgs::angle_deg(vec_cast<double>(a), vec_cast<double>(b));
}
/// (lambda_2 - lambda_3) / lambda_1.
inline double relative_gap(Vec3f eigenvalues) {
    return eigenvalues.x > 0 ? double(eigenvalues.y - eigenvalues.z) / eigenvalues.x : 0;
}

struct Cloud {
    std::vector<Vec3f> means, scales;
    std::vector<Quatf> quats;

    int size() const { return static_cast<int>(means.size()); }
    void add(Vec3f mean, Vec3f scale, Quatf quat) {
        means.push_back(mean), scales.push_back(scale), quats.push_back(quat);
    }
};

/// The shortest rotation that takes the z axis to `n`.
inline Quatf quat_from_z(Vec3f n) {
    const Vec3f half = n + Vec3f{0, 0, 1};
    if (norm(half) < 1e-6f) return {0, 1, 0, 0};
    return normalize(Quatf{half.z, -half.y, half.x, 0});
}

template <class Device>
Gaussians<Device> to_gaussians(const Cloud& cloud) {
    std::vector<Vec3f> log_scales;
    for (const Vec3f s : cloud.scales)
        log_scales.push_back({std::log(s.x), std::log(s.y), std::log(s.z)});
    Gaussians<Device> g;
    resize(g, cloud.size(), 0);
    copy(cloud.means, g.means);
    copy(log_scales, g.log_scales);
    copy(cloud.quats, g.quats);
    g.opacity_logits.fill_zero();
    g.sh.fill_zero();
    return g;
}

/// Like the function in apps/bench/field.h, on Gaussians.
template <class Device>
FieldOnHost run_events(const Cloud& cloud,
                       const TvOptions& options,
                       int events,
                       const std::vector<std::uint32_t>& receivers = {}) {
    return tvsgs::run_events(to_gaussians<Device>(cloud), options, events, receivers);
}

/// Own sampler: std::normal_distribution differs between libraries.
class Random {
public:
    explicit Random(unsigned seed) : engine_(seed) {}
    float uniform(float low = 0, float high = 1) {
        return low + (high - low) * static_cast<float>(engine_() >> 8) * (1.0f / 16777216);
    }
    float normal() {
        float sum = 0;
        for (int i = 0; i < 12; ++i) sum += uniform();
        return sum - 6;
    }
    Vec3f normal3() { return {normal(), normal(), normal()}; }
    Quatf quat() { return normalize(Quatf{normal(), normal(), normal(), normal()}); }
    /// In-plane deviations of about `base`, flattened across.
    Vec3f flat_scales(float base) {
        return {base * std::exp(0.5f * normal()), base * std::exp(0.5f * normal()),
                0.1f * base * std::exp(0.5f * normal())};
    }

private:
    std::mt19937 engine_;
};

inline TvOptions options_with(int k) {
    TvOptions options;
    options.k = k;
    return options;
}

inline double median_of(std::vector<double> values) {
    std::nth_element(values.begin(), values.begin() + std::ptrdiff_t(values.size() / 2),
                     values.end());
    return values[values.size() / 2];
}

inline Vec3f tilted(Random& random, Vec3f normal, float by) {
    return normalize(normal + by * random.normal3());
}

inline bool same_bits(const FieldOnHost& a, const FieldOnHost& b) {
    const auto equal = [](const auto& x, const auto& y) {
        return x.size() == y.size() &&
               std::memcmp(x.data(), y.data(), x.size() * sizeof(x[0])) == 0;
    };
    return equal(a.tensors, b.tensors) && equal(a.eigenvalues, b.eigenvalues) &&
           equal(a.normals, b.normals) && equal(a.targets, b.targets) && equal(a.flags, b.flags);
}

/// Splats near the unit sphere, with noise in their positions, scales and normals.
inline Cloud sphere(int count, unsigned seed, float noise = 0.01f) {
    Random random(seed);
    Cloud cloud;
    const float spacing = std::sqrt(12.57f / float(count));
    for (int i = 0; i < count; ++i) {
        const Vec3f n = normalize(random.normal3());
        cloud.add((1 + noise * random.normal()) * n, random.flat_scales(0.5f * spacing),
                  quat_from_z(tilted(random, n, 0.1f)));
    }
    return cloud;
}

/// Every splat votes for splat 5, and otherwise for near or random ones.
inline std::vector<std::uint32_t> made_up_lists(int count, int k) {
    Random random(11);
    std::vector<std::uint32_t> receivers;
    for (int i = 0; i < count; ++i) {
        std::vector<std::uint32_t> row = {i == 5 ? 6u : 5u};
        while (static_cast<int>(row.size()) < k) {
            const float at = i % 2 == 0 ? random.uniform(0, float(count) - 1)
                                        : float(i) + 2.0f * float(k) * (random.uniform() - 0.5f);
            const auto j = static_cast<std::uint32_t>(std::clamp(at, 0.0f, float(count) - 1));
            if (int(j) != i && std::find(row.begin(), row.end(), j) == row.end()) row.push_back(j);
        }
        std::sort(row.begin(), row.end());
        receivers.insert(receivers.end(), row.begin(), row.end());
    }
    return receivers;
}

/// The devices of this build.
using Devices = std::conditional_t<kHasCuda, ::testing::Types<Cpu, Cuda>, ::testing::Types<Cpu>>;

template <class Device>
bool device_missing() {
    if constexpr (std::is_same_v<Device, Cuda>)
        return cuda_device_count() == 0;
    else
        return false;
}

}  // namespace tvsgs::test

#define TVSGS_SKIP_WITHOUT_DEVICE(Device) \
    if (tvsgs::test::device_missing<Device>()) GTEST_SKIP() << "no GPU here"
