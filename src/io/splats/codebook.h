// Quantisation of numbers to 256 codes by one-dimensional k-means.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace tvsgs {

/// Increasing numbers.
using Codebook = std::array<float, 256>;

/// Codes with a small mean squared distance to `values`, which must be finite: Lloyd's algorithm on
/// at most 2^20 evenly spaced values. Up to 256 distinct values all become codes. Does not depend
/// on the number of threads.
Codebook make_codebook(std::vector<float> values);

/// Index of the nearest code.
std::uint8_t nearest_code(const Codebook& codes, float value);

}  // namespace tvsgs
