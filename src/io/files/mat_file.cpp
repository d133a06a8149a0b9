#include <matio.h>
#include <sys/mman.h>
#include <unistd.h>
#include <zlib.h>

#include <bit>
#include <cstring>
#include <memory>
#include <utility>

#include "io/files/npz.h"
#include "io/files/number_types.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

constexpr std::int64_t kMaxEntries = std::int64_t{1} << 28;
constexpr std::int64_t kDeflateLimit = 1032;  // largest ratio of unpacked to packed bytes of zlib
// Layout of a variable: flags (tag and 8 bytes), shape (tag, 4 bytes per dimension, up to 32 of
// them), name (tag and letters; up to 4 are part of the tag; MATLAB allows 63).
constexpr std::size_t kTag = 8, kShape = 24, kMaxShape = 4 * 32, kMaxName = 64,
                      kHead = kShape + kMaxShape + kTag + kMaxName;

template <class... Parts>
Error mat_error(const std::string& path, const Parts&... parts) {
    return input_error("E_MAT: ", path, ": ", parts...);
}

std::uint32_t word(std::string_view bytes, std::size_t at, bool swap) {
    std::uint32_t value;
    std::memcpy(&value, bytes.data() + at, sizeof value);
    return swap ? __builtin_bswap32(value) : value;
}

/// The first bytes of a variable after its tag, unpacked if compressed.
std::string head_of(std::string_view data, bool compressed) {
    if (!compressed) return std::string(data.substr(0, kHead));
    std::string head(kTag + kHead, '\0');
    z_stream stream{};
    if (inflateInit(&stream) != Z_OK) return "";
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(data.data()));
    stream.avail_in = static_cast<uInt>(data.size());
    stream.next_out = reinterpret_cast<Bytef*>(head.data());
    stream.avail_out = static_cast<uInt>(head.size());
    inflate(&stream, Z_SYNC_FLUSH);
    head.resize(head.size() - stream.avail_out);
    inflateEnd(&stream);
    return head.size() > kTag ? head.substr(kTag) : "";
}

/// The parts of a file that libmatio gets: the header and the array `name`. libmatio would read a
/// cut-off file as if it ended in zeros, and allocate any size that names, shapes and nested
/// variables claim.
std::string only_variable(const std::string& path, const std::string& name) {
    constexpr std::size_t kFileHeader = 128;
    const std::string bytes = read_bytes(path);
    if (bytes.starts_with("\x89HDF") || bytes.find("MATLAB 7.3") < kFileHeader)
        throw input_error("E_MAT_V73: ", path,
                          ": a MATLAB 7.3 (HDF5) file; save it again with save('-v7', ...)");
    if (!bytes.starts_with("MATLAB 5.0"))
        throw mat_error(path, "not a MATLAB 5 to 7 file; expected 'MATLAB 5.0' at its start");
    if (bytes.size() < kFileHeader + kTag)
        throw mat_error(path, "cut off: ", bytes.size(), " bytes; copy the file again");
    const bool little = bytes[126] == 'I' && bytes[127] == 'M';
    const bool swap = little != (std::endian::native == std::endian::little);
    std::string found;
    for (std::size_t at = kFileHeader, size = 0; at < bytes.size(); at += kTag + size) {
        const std::size_t left = bytes.size() - at;
        size = left < kTag ? 0 : word(bytes, at + 4, swap);
        if (left < kTag || left - kTag < size)
            throw mat_error(path, "byte ", at, ": an element of ", size, " bytes, but ", left,
                            " are left; the file is cut off: copy it again");
        const std::uint32_t type = word(bytes, at, swap);
        if (type != 14 && type != 15) continue;  // not a variable
        const bool compressed = type == 15;
        const std::string head =
            head_of(std::string_view(bytes).substr(at + kTag, size), compressed);
        const auto require = [&](bool sound) {
            if (!sound)
                throw mat_error(path, "byte ", at,
                                ": cannot decode a variable; the file is damaged: copy it again");
        };
        const auto number = [&](std::size_t i) {
            require(i + 4 <= head.size());
            return word(head, i, swap);
        };
        const std::size_t shape = number(kShape - 4), tag = kShape + (shape + 7) / 8 * 8;
        require(shape >= 8 && shape <= kMaxShape && shape % 4 == 0);
        const std::size_t in_tag = number(tag) >> 16,
                          length = in_tag > 0 ? in_tag : number(tag + 4);
        require(in_tag <= 4 && length <= kMaxName);
        if (head.substr(tag + (in_tag > 0 ? 4 : kTag), length) != name) continue;

        const std::uint32_t array_class = number(8) & 0xff;
        if (array_class < MAT_C_SPARSE || array_class > MAT_C_UINT64)
            throw mat_error(path, "'", name,
                            "' is not a numeric array (a cell, a structure or text)");
        std::int64_t entries = 1;
        for (std::size_t i = kShape; i + 4 <= kShape + shape; i += 4) {
            const auto extent = static_cast<std::int64_t>(number(i));
            if (extent > 0 && entries > kMaxEntries / extent)
                throw mat_error(path, "'", name, "' has more than 2^28 entries");
            entries *= extent;
        }
        if (entries > (compressed ? kDeflateLimit : 1) * static_cast<std::int64_t>(size))
            throw mat_error(path, "'", name, "' claims ", entries, " entries, too many for ", size,
                            " bytes; the file is damaged: copy it again");
        if (found.empty()) found = bytes.substr(0, kFileHeader) + bytes.substr(at, kTag + size);
    }
    if (found.empty()) throw mat_error(path, "no variable '", name, "'");
    return found;
}

/// A file in memory, because libmatio only accepts a path.
class MemoryFile {
public:
    explicit MemoryFile(const std::string& bytes) : descriptor_(memfd_create("tvsgs", 0)) {
        if (descriptor_ < 0 ||
            write(descriptor_, bytes.data(), bytes.size()) != static_cast<ssize_t>(bytes.size()))
            throw Error(ExitCode::io, "cannot make a file in memory");
    }
    MemoryFile(const MemoryFile&) = delete;
    MemoryFile& operator=(const MemoryFile&) = delete;
    ~MemoryFile() { close(descriptor_); }
    std::string path() const { return str("/proc/self/fd/", descriptor_); }

private:
    int descriptor_;
};

/// Null if the class is not numeric.
const NumberType* type_of(int array_class) {
    constexpr std::pair<char, std::size_t> kTypes[] = {{'f', 8}, {'f', 4}, {'i', 1}, {'u', 1},
                                                       {'i', 2}, {'u', 2}, {'i', 4}, {'u', 4},
                                                       {'i', 8}, {'u', 8}};
    static_assert(MAT_C_UINT64 - MAT_C_DOUBLE + 1 == std::size(kTypes));
    if (array_class < MAT_C_DOUBLE || array_class > MAT_C_UINT64) return nullptr;
    const auto& [kind, bytes] = kTypes[array_class - MAT_C_DOUBLE];
    return find_number_type(kind, bytes);
}

}  // namespace

MatArray read_mat_array(const std::string& path, const std::string& name) {
    const MemoryFile alone(only_variable(path, name));
    // Suppresses libmatio's own messages on standard error. Newer versions pass const char*.
    Mat_LogInitFunc("tvsgs", [](int, auto*) {});
    const std::unique_ptr<mat_t, decltype(&Mat_Close)> file(
        Mat_Open(alone.path().c_str(), MAT_ACC_RDONLY), Mat_Close);
    if (!file) throw mat_error(path, "cannot open it as a MATLAB file");
    const std::unique_ptr<matvar_t, decltype(&Mat_VarFree)> info(
        Mat_VarReadInfo(file.get(), name.c_str()), Mat_VarFree);
    if (!info) throw mat_error(path, "no variable '", name, "'");

    MatArray array;
    std::int64_t count = 1;
    for (int i = 0; i < info->rank; ++i) {
        count *= static_cast<std::int64_t>(info->dims[i]);
        array.shape.push_back(static_cast<std::int64_t>(info->dims[i]));
    }
    if (info->isComplex || info->class_type == MAT_C_SPARSE)
        throw mat_error(path, "'", name, "' is complex or sparse; expected a full real array");
    const std::unique_ptr<matvar_t, decltype(&Mat_VarFree)> variable(
        Mat_VarRead(file.get(), name.c_str()), Mat_VarFree);
    if (!variable || (count > 0 && variable->data == nullptr) ||
        variable->nbytes !=
            static_cast<std::size_t>(count) * static_cast<std::size_t>(variable->data_size))
        throw mat_error(path, "'", name, "' cannot be decoded; is the file damaged?");
    array.numbers.resize(static_cast<std::size_t>(count));
    const NumberType* const type = type_of(variable->class_type);
    if (!type)
        throw mat_error(path, "'", name, "' is not a numeric array (a cell, a structure or text)");
    for (std::size_t i = 0; i < array.numbers.size(); ++i)
        array.numbers[i] = type->load(static_cast<const char*>(variable->data) + i * type->bytes);
    return array;
}

}  // namespace tvsgs
