// Clouds, and voting events with results on the host, for the tests of tensor voting.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include "core/cuda_device.h"
#include "core/gaussians.h"
#include "tv/vote_math.h"
#include "tv/voting.h"

namespace tvsgs::test {

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

struct FieldOnHost {
    std::vector<Sym3f> tensors;
    std::vector<Vec3f> eigenvalues, normals, targets;
    std::vector<std::uint8_t> flags;
    VotingDetails details;
};

template <class Device>
FieldOnHost read(const TensorField<Device>& field, const TensorVoter<Device>& voter) {
    return {to_host(field.tensors), to_host(field.eigenvalues), to_host(field.normals),
            to_host(field.targets), to_host(field.flags),       voter.details()};
}

/// `events` events on a static cloud: the first is a ball round and a plate round, the others a
/// plate round each; virtual receivers follow every time. `receivers`: lists to use instead of a
/// search.
template <class Device>
FieldOnHost run_events(const Cloud& cloud,
                       const TvOptions& options,
                       int events,
                       const std::vector<std::uint32_t>& receivers = {}) {
    const Gaussians<Device> g = to_gaussians<Device>(cloud);
    TensorVoter<Device> voter(options);
    if (!receivers.empty())
        voter.set_receivers(options.start, static_cast<int>(receivers.size()) / cloud.size(),
                            receivers);
    TensorField<Device> field;
    for (int event = 0; event < events; ++event)
        voter.vote(options.start + event * options.vote_every, g, field);
    return read(field, voter);
}

inline double frobenius(const Sym3f& T) {
    const double off = double(T.xy) * T.xy + double(T.xz) * T.xz + double(T.yz) * T.yz;
    return std::sqrt(double(T.xx) * T.xx + double(T.yy) * T.yy + double(T.zz) * T.zz + 2 * off);
}
inline Sym3f difference(const Sym3f& a, const Sym3f& b) {
    return {a.xx - b.xx, a.xy - b.xy, a.xz - b.xz, a.yy - b.yy, a.yz - b.yz, a.zz - b.zz};
}
/// Between two axes; exact for small angles.
inline double angle_deg(Vec3<double> a, Vec3<double> b) {
    return std::atan2(norm(cross(a, b)), std::abs(dot(a, b))) * 180 / 3.14159265358979;
}
inline double angle_deg(Vec3f a, Vec3f b) {
    return angle_deg(vec_cast<double>(a), vec_cast<double>(b));
}
/// (lambda_2 - lambda_3) / lambda_1.
inline double relative_gap(Vec3f eigenvalues) {
    return eigenvalues.x > 0 ? double(eigenvalues.y - eigenvalues.z) / eigenvalues.x : 0;
}

inline std::vector<std::uint32_t> sorted_row(const std::vector<std::uint32_t>& lists,
                                             int k,
                                             int i) {
    std::vector<std::uint32_t> row(lists.begin() + std::ptrdiff_t(i) * k,
                                   lists.begin() + std::ptrdiff_t(i + 1) * k);
    std::sort(row.begin(), row.end());
    return row;
}

/// Same draws everywhere: std::normal_distribution differs between libraries.
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

/// The twins of this build.
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
