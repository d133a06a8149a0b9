// Synthetic splats as they are after training, and worst cases of the neighbour search.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/scene/gaussians.h"

namespace tvsgs {

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
