// Arrays of numbers in files: .npy and .npz of NumPy, safetensors, MATLAB.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace tvsgs {

/// One row-major array. All numeric types become double.
struct NpyArray {
    std::vector<std::int64_t> shape;  // empty: a scalar
    std::vector<double> numbers;      // [product of shape]; empty for text
    std::string text;                 // a scalar string; '?' for characters beyond ASCII
    bool is_text = false;
    std::int64_t size() const;
};

/// Parses the bytes of a .npy file: bool, 8- to 64-bit integers, 16- to 64-bit floats of either
/// byte order, scalar Unicode strings. Messages contain `name`. Throws Error(ExitCode::input), also
/// for pickled objects and structured types.
NpyArray parse_npy(std::string_view bytes, const std::string& name);

/// Reads a .npy file. Throws like parse_npy().
NpyArray read_npy(const std::string& path);

/// Writes little-endian float32, row major, as an atomic file.
void write_npy(const std::string& path,
               const std::vector<std::int64_t>& shape,
               const float* numbers);

/// All arrays of an archive by name, without ".npy". Checks checksums and limits: 1 GiB per entry,
/// 65,536 entries, compression ratio 1,100. Throws Error(ExitCode::input).
using NpzArchive = std::map<std::string, NpyArray>;
NpzArchive read_npz(const std::string& path);

/// All tensors of type F16, F32 or F64 by name. Checks the header, ranges and overlaps. Throws
/// Error(ExitCode::input).
NpzArchive read_safetensors(const std::string& path);

/// Reads a .npz or .safetensors file; the first bytes tell the format.
NpzArchive read_tensors(const std::string& path);

/// The array with this name. Throws Error(ExitCode::input) that lists the existing names.
const NpyArray& find_array(const NpzArchive& archive, const std::string& name);

// MATLAB v5 to v7, by libmatio; in the library tvsgs_mat.

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
