// Few vectors that stand for many: k-means of harmonics.
#pragma once

#include <cstdint>
#include <vector>

namespace tvsgs {

struct ShPalette {
    std::vector<float> centres;         // [count, numbers]
    std::vector<std::uint16_t> labels;  // [N] the centre of each
    int count = 0;
};

/// At most `count` (65536) centres for `vectors`, [N, numbers] that are all finite. Lloyd's steps
/// from vectors at fixed distances, for up to 256 centres; more of them are shared out among 256
/// cells by how many vectors each has, and so on. Vectors that are near in the list should be so in
/// space. Does not depend on the number of threads; takes N * numbers * 5000 multiplications.
ShPalette make_sh_palette(const std::vector<float>& vectors, int numbers, int count);

}  // namespace tvsgs
