// Synthetic splats as they are after training, and worst cases of the neighbour search.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/math/rng.h"
#include "core/scene/gaussians.h"

namespace tvsgs {

/// The draws of one splat, in a fixed order.
class Draws {
public:
    Draws(std::uint64_t seed, int index) : seed_(seed), index_(static_cast<std::uint64_t>(index)) {}
    double uniform(double low = 0, double high = 1) {
        if (next_ == 4) block_ = block(), next_ = 0;
        return low + (high - low) * double(tvsgs::uniform(block_.v[next_++]));
    }
    Vec3d normal3() { return vec_cast<double>(tvsgs::normal3(block())); }
    Vec3d direction() { return normalize(normal3()); }

private:
    Random4 block() { return random4(seed_, RandomStream::test, index_, sub_++); }
    std::uint64_t seed_, index_;
    std::uint32_t sub_ = 0;
    Random4 block_{};
    int next_ = 4;
};

/// A rotation from z to the direction `to`, after a turn about z by twice the angle `turn`.
Quat<double> turned_to(Vec3d to, double turn);

/// "sphere", "planes", ... in the order of the help.
const std::vector<std::string>& bench_shapes();

/// A pure function of its arguments; the splats come in random order. Lengths are in radii of the
/// scene; h is the spacing sqrt(area / splats) where a splat lies.
///
///   sphere      radius 1; 16 times as dense at one pole as at the other
///   planes      two squares of side 2 that cross
///   cluster     five flat clusters, spacings from 1 to 100 (densities 1 to 10^4), 1% duplicates
///   line        a segment of length 2
///   coincident  half of the splats in one point, the others as sphere
///   outliers    as sphere, but a fifth of the splats at distances of 2 to 10^6, one at 10^12
///
/// Each splat is off its surface by 0.1 h and tilted by 0.1 rad (normal deviates), has in-plane
/// scales 0.7 h exp(0.5 normal) of their own and a thickness of 3% of the smaller one, exp(0.5
/// normal), turned at random about its normal. 2% are strays: anywhere within 1.5 radii, turned at
/// random, of scale 3 h. The shapes line and coincident have no strays.
Gaussians<Cpu> make_bench_cloud(const std::string& shape, int count, std::uint64_t seed);

}  // namespace tvsgs
