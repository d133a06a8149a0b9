// Quantisation of SH coefficients to a palette of vectors by k-means.
#pragma once

#include <cstdint>
#include <vector>

namespace tvsgs {

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
