// Arrays saved by NumPy.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace tvsgs {

/// One array, row major; every numeric type is widened to double.
struct NpyArray {
    std::vector<std::int64_t> shape;  // empty: a scalar
    std::vector<double> numbers;      // [product of shape]; empty for text
    std::string text;                 // of a scalar Unicode string, UTF-8

    bool is_text = false;
    std::int64_t size() const;
};

/// Bytes of one .npy file: bool, 8- to 64-bit integers, floats of 16 to 64 bits of either byte
/// order, scalar Unicode strings. `name` is for messages. Throws Error(ExitCode::input), also for
/// pickled objects and structured types.
NpyArray parse_npy(std::string_view bytes, const std::string& name);

NpyArray read_npy(const std::string& path);

/// Writes little-endian float32, row major; temporary file, flushed, renamed.
void write_npy(const std::string& path,
               const std::vector<std::int64_t>& shape,
               const float* numbers);

/// All arrays of an archive by name, without ".npy". Checksums, sizes (1 GiB per entry, 65,536
/// entries) and compression ratios (1,100) are checked. Throws Error(ExitCode::input).
using NpzArchive = std::map<std::string, NpyArray>;
NpzArchive read_npz(const std::string& path);

/// The array of that name; throws Error(ExitCode::input) naming those there are.
const NpyArray& find_array(const NpzArchive& archive, const std::string& name);

}  // namespace tvsgs
