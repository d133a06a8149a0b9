// Writing .npz files, which our programs only read.
#pragma once

#include <zip.h>

#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "io/files/npz.h"

namespace tvsgs::test {

/// Arrays as float64, text as UTF-32.
inline std::string npy_bytes(const NpyArray& array) {
    std::u32string text(array.text.begin(), array.text.end());  // ASCII
    std::string shape;
    for (const std::int64_t n : array.shape) shape += std::to_string(n) + ",";
    std::string header = "{'descr': '" +
                         (array.is_text ? "<U" + std::to_string(text.size()) : std::string("<f8")) +
                         "', 'fortran_order': False, 'shape': (" + shape + "), }";
    header += std::string(63 - (10 + header.size()) % 64, ' ') + "\n";
    std::string bytes("\x93NUMPY\x01\x00", 8);
    bytes += static_cast<char>(header.size() & 255);
    bytes += static_cast<char>(header.size() >> 8);
    bytes += header;
    const auto append = [&](const void* data, std::size_t size) {
        bytes.append(static_cast<const char*>(data), size);
    };
    if (array.is_text)
        append(text.data(), text.size() * sizeof(char32_t));
    else
        append(array.numbers.data(), array.numbers.size() * sizeof(double));
    return bytes;
}

inline void write_npz(const std::string& path, const NpzArchive& arrays) {
    zip_t* const zip = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, nullptr);
    if (zip == nullptr) throw std::runtime_error("cannot write " + path);
    std::vector<std::string> contents;  // libzip reads them when it closes
    contents.reserve(arrays.size());
    for (const auto& [name, array] : arrays) {
        contents.push_back(npy_bytes(array));
        zip_source_t* const source =
            zip_source_buffer(zip, contents.back().data(), contents.back().size(), 0);
        zip_file_add(zip, (name + ".npy").c_str(), source, ZIP_FL_OVERWRITE);
    }
    if (zip_close(zip) != 0) throw std::runtime_error("cannot write " + path);
}

}  // namespace tvsgs::test
