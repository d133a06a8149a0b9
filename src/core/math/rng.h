// Counter-based random numbers: a pure function of (seed, stream, index), equal on both devices and
// independent of the order of the calls.
#pragma once

#include <cstdint>

#include "core/math/vec.h"

namespace tvsgs {

/// Purpose of a draw. Each purpose has its own stream, so two purposes never share numbers.
enum class RandomStream : std::uint32_t {
    view_order = 1,
    densify = 2,
    init = 3,
    sampling = 4,
    test = 5,
    neighbour_views = 6,
    patches = 7,
    stereo = 8,
    thinning = 9,
    ransac = 10,
    lines = 11,
    depth_pairs = 20,
    depth_ranks = 21,
    background = 22,
    pose_noise = 23,
    dropout = 24
};

/// Four words of 32 random bits.
struct Random4 {
    std::uint32_t v[4];
};

/// Philox 4x32 with ten rounds.  [Salmon11]
TVSGS_HD inline Random4 philox(Random4 counter, std::uint32_t key0, std::uint32_t key1) {
    for (int round = 0; round < 10; ++round) {
        const std::uint64_t a = 0xD2511F53ull * counter.v[0];
        const std::uint64_t b = 0xCD9E8D57ull * counter.v[2];
        counter = {{static_cast<std::uint32_t>(b >> 32) ^ counter.v[1] ^ key0,
                    static_cast<std::uint32_t>(b),
                    static_cast<std::uint32_t>(a >> 32) ^ counter.v[3] ^ key1,
                    static_cast<std::uint32_t>(a)}};
        key0 += 0x9E3779B9u;
        key1 += 0xBB67AE85u;
    }
    return counter;
}

/// `index` and `sub` number the draw within the stream, for example splat and iteration.
TVSGS_HD inline Random4 random4(std::uint64_t seed,
                                RandomStream stream,
                                std::uint64_t index,
                                std::uint32_t sub = 0) {
    return philox({{static_cast<std::uint32_t>(index), static_cast<std::uint32_t>(index >> 32), sub,
                    static_cast<std::uint32_t>(stream)}},
                  static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32));
}

/// Uniform in the open interval (0, 1), so it is safe under a logarithm and as a share of a count.
/// 23 bits and a half are exact in float.
TVSGS_HD inline float uniform(std::uint32_t bits) {
    return (static_cast<float>(bits >> 9) + 0.5f) * (1.0f / 8388608.0f);
}

/// Three independent standard normal numbers.  [Box58]
TVSGS_HD inline Vec3f normal3(Random4 r) {
    constexpr float kTwoPi = 6.28318530718f;
    const float radius0 = std::sqrt(-2 * std::log(uniform(r.v[0])));
    const float radius1 = std::sqrt(-2 * std::log(uniform(r.v[2])));
    const float angle0 = kTwoPi * uniform(r.v[1]), angle1 = kTwoPi * uniform(r.v[3]);
    return {radius0 * std::cos(angle0), radius0 * std::sin(angle0), radius1 * std::cos(angle1)};
}

}  // namespace tvsgs
