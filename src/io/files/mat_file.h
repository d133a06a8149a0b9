// Reading of numeric arrays from MATLAB files (v5 to v7) by libmatio.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace tvsgs {

/// A column-major array, as MATLAB stores it. All numeric and logical types become double.
struct MatArray {
    std::vector<std::int64_t> shape;
    std::vector<double> numbers;  // [product of shape]
};

/// Reads one variable of a file. Throws Error(ExitCode::input): E_MAT if the file is damaged, has
/// no such variable, or the variable is not a real numeric array of at most 2^28 entries; E_MAT_V73
/// for HDF5 files.
MatArray read_mat_array(const std::string& path, const std::string& name);

}  // namespace tvsgs
