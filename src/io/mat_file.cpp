#include "io/mat_file.h"

#include <matio.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <memory>

#include "io/read_file.h"

namespace tvsgs {
namespace {

constexpr std::int64_t kMaxEntries = std::int64_t{1} << 28;
constexpr std::int64_t kDeflateLimit = 1032;  // bytes that zlib makes of one, at most

template <class... Parts>
Error mat_error(const std::string& path, const Parts&... parts) {
    return input_error("E_MAT: ", path, ": ", parts...);
}

/// libmatio takes a cut-off file for one that ends in zeros: every element must be there in full.
/// Returns the size of the largest one.
std::int64_t check_complete(const std::string& path) {
    constexpr std::size_t kHeader = 128, kTag = 8;
    const std::string bytes = read_bytes(path);
    if (bytes.starts_with("\x89HDF") || bytes.find("MATLAB 7.3") < kHeader)
        throw input_error("E_MAT_V73: ", path,
                          ": a MATLAB 7.3 (HDF5) file; save it anew with save('-v7', ...)");
    if (!bytes.starts_with("MATLAB 5.0"))
        throw mat_error(path, "not a MATLAB 5 to 7 file; expected 'MATLAB 5.0' at its start");
    if (bytes.size() < kHeader + kTag)
        throw mat_error(path, "cut off: ", bytes.size(), " bytes; copy the file again");
    const bool little = bytes[126] == 'I' && bytes[127] == 'M';
    const bool swap = little != (std::endian::native == std::endian::little);
    std::int64_t largest = 0;
    for (std::size_t at = kHeader; at < bytes.size();) {
        std::uint32_t size = 0;
        if (bytes.size() - at >= kTag) std::memcpy(&size, bytes.data() + at + 4, 4);
        if (swap) size = __builtin_bswap32(size);
        if (bytes.size() - at < kTag || bytes.size() - at - kTag < size)
            throw mat_error(path, "byte ", at, ": an element of ", size, " bytes, but only ",
                            bytes.size() - at, " are left: the file is cut off; copy it again");
        at += kTag + size;
        largest = std::max(largest, static_cast<std::int64_t>(size));
    }
    return largest;
}

template <class T>
void widen(const matvar_t& variable, std::vector<double>& numbers) {
    const T* const from = static_cast<const T*>(variable.data);
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = static_cast<double>(from[i]);
}

/// False when the class is not numeric.
bool widen(const matvar_t& variable, std::vector<double>& numbers) {
    switch (variable.class_type) {
        case MAT_C_DOUBLE:
            return widen<double>(variable, numbers), true;
        case MAT_C_SINGLE:
            return widen<float>(variable, numbers), true;
        case MAT_C_INT8:
            return widen<std::int8_t>(variable, numbers), true;
        case MAT_C_UINT8:
            return widen<std::uint8_t>(variable, numbers), true;
        case MAT_C_INT16:
            return widen<std::int16_t>(variable, numbers), true;
        case MAT_C_UINT16:
            return widen<std::uint16_t>(variable, numbers), true;
        case MAT_C_INT32:
            return widen<std::int32_t>(variable, numbers), true;
        case MAT_C_UINT32:
            return widen<std::uint32_t>(variable, numbers), true;
        case MAT_C_INT64:
            return widen<std::int64_t>(variable, numbers), true;
        case MAT_C_UINT64:
            return widen<std::uint64_t>(variable, numbers), true;
        default:
            return false;
    }
}

}  // namespace

MatArray read_mat_array(const std::string& path, const std::string& name) {
    const std::int64_t largest = check_complete(path);
    // Its messages would go to standard error beside ours.
    Mat_LogInitFunc("tvsgs", [](int, char*) {});
    const std::unique_ptr<mat_t, decltype(&Mat_Close)> file(Mat_Open(path.c_str(), MAT_ACC_RDONLY),
                                                            Mat_Close);
    if (!file) throw mat_error(path, "libmatio cannot open it as a MATLAB file");
    const std::unique_ptr<matvar_t, decltype(&Mat_VarFree)> info(
        Mat_VarReadInfo(file.get(), name.c_str()), Mat_VarFree);
    if (!info) throw mat_error(path, "holds no variable '", name, "'");

    MatArray array;
    std::int64_t count = 1;
    for (int i = 0; i < info->rank; ++i) {
        const auto extent = static_cast<std::int64_t>(info->dims[i]);
        if (extent < 0 || (extent > 0 && count > kMaxEntries / extent))
            throw mat_error(path, "'", name, "' has more than 2^28 entries");
        count *= extent;
        array.shape.push_back(extent);
    }
    if (info->isComplex || info->class_type == MAT_C_SPARSE)
        throw mat_error(path, "'", name, "' is complex or sparse; expected a full real array");
    // libmatio takes memory for what a shape claims; numbers are stored in a byte or more each.
    if (count > kDeflateLimit * largest)
        throw mat_error(path, "'", name, "' claims ", count, " entries, more than the ", largest,
                        " bytes of the largest element can hold: is the file damaged?");
    const std::unique_ptr<matvar_t, decltype(&Mat_VarFree)> variable(
        Mat_VarRead(file.get(), name.c_str()), Mat_VarFree);
    if (!variable || (count > 0 && variable->data == nullptr) ||
        variable->nbytes !=
            static_cast<std::size_t>(count) * static_cast<std::size_t>(variable->data_size))
        throw mat_error(path, "'", name, "' cannot be decoded: is the file damaged?");
    array.numbers.resize(static_cast<std::size_t>(count));
    if (!widen(*variable, array.numbers))
        throw mat_error(path, "'", name,
                        "' is no numeric array (a cell, a structure or text); expected numbers");
    return array;
}

}  // namespace tvsgs
