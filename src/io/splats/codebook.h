// Quantisation by k-means: of numbers to 256 codes, of SH coefficients to a palette of vectors.
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

/// Centres, and the centre of each vector.
struct ShPalette {
    std::vector<float> centres;         // [N] index of each vector's centre
    std::vector<std::uint16_t> labels;  // [N] the centre of each
    int count = 0;
};

/// At most `count` (65536) centres for `vectors` [N, numbers], which must be finite. Lloyd's
/// algorithm with evenly spaced start vectors finds up to 256 centres. For more centres it splits
/// the vectors into 256 cells, shares the centres among the cells by their numbers of vectors, and
/// repeats in each cell. Vectors that are neighbours in the list should be neighbours in space.
/// Does not depend on the number of threads. Costs N * numbers * 5000 multiplications.
ShPalette make_sh_palette(const std::vector<float>& vectors, int numbers, int count);

}  // namespace tvsgs
