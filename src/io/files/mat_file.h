// Numeric arrays of MATLAB files (v5 to v7), through libmatio.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace tvsgs {

/// Column major, as MATLAB stores it; every numeric type, logical too, is widened to double.
struct MatArray {
    std::vector<std::int64_t> shape;
    std::vector<double> numbers;  // [product of shape]
};

/// One variable of a file. Throws Error(ExitCode::input): E_MAT where the file is damaged, lacks
/// the variable, or holds something else than a real numeric array of at most 2^28 entries under
/// that name; E_MAT_V73 for HDF5.
MatArray read_mat_array(const std::string& path, const std::string& name);

}  // namespace tvsgs
