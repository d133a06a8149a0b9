// 256 numbers that stand for many: k-means along a line.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace tvsgs {

/// Increasing.
using Codebook = std::array<float, 256>;

/// Codes that are near `values`, all of which are finite, in the mean square: by Lloyd's steps over
/// at most 2^20 of them at fixed distances. Up to 256 different values are all
/// codes. Does not depend on the number of threads.
Codebook make_codebook(std::vector<float> values);

/// The nearest code.
std::uint8_t nearest_code(const Codebook& codes, float value);

}  // namespace tvsgs
