// The elements of a file: tag (type, bytes), data, zeros up to a multiple of 8 bytes. A variable is
// one of type 14 that holds others: flags with its class, shape, name, numbers; or one of type 15,
// which is that compressed.  [MATLAB, MAT-File Format, Level 5]
#include "io/mat_file.h"

#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <optional>

#include "io/read_file.h"

namespace tvsgs {
namespace {

constexpr std::int64_t kMaxEntries = std::int64_t{1} << 28;
constexpr std::size_t kHeader = 128, kTag = 8;

enum Type : std::uint32_t { kUint32 = 6, kInt32 = 5, kInt8 = 1, kMatrix = 14, kCompressed = 15 };
enum Class : std::uint32_t { kText = 4, kSparse = 5, kLastNumeric = 15 };

template <class T>
T load(const char* at, bool swap) {
    char bytes[sizeof(T)];
    std::copy(at, at + sizeof(T), bytes);
    if (swap) std::reverse(bytes, bytes + sizeof(T));
    T value;
    std::memcpy(&value, bytes, sizeof value);
    return value;
}

template <class T>
void widen(const std::string& from, bool swap, std::vector<double>& numbers) {
    for (std::size_t i = 0; i < numbers.size(); ++i)
        numbers[i] = static_cast<double>(load<T>(&from[i * sizeof(T)], swap));
}

struct Storage {
    std::uint32_t type;
    std::size_t bytes;
    void (*widen)(const std::string&, bool swap, std::vector<double>&);
};

constexpr Storage kStorages[] = {
    {1, 1, widen<std::int8_t>},    {2, 1, widen<std::uint8_t>}, {3, 2, widen<std::int16_t>},
    {4, 2, widen<std::uint16_t>},  {5, 4, widen<std::int32_t>}, {6, 4, widen<std::uint32_t>},
    {7, 4, widen<float>},          {9, 8, widen<double>},       {12, 8, widen<std::int64_t>},
    {13, 8, widen<std::uint64_t>},
};

/// One file; every complaint names it.
struct MatReader {
    std::string path;
    bool swap = false;

    template <class... Parts>
    Error wrong(const Parts&... parts) const {
        return input_error("E_MAT: ", path, ": ", parts...);
    }
    Error damaged(const char* what) const {
        return wrong(what, " cannot be decoded: the file is damaged; copy it again");
    }
    std::uint32_t word(const char* at) const { return load<std::uint32_t>(at, swap); }
};

/// The bytes of one element, inflated as they are asked for: never more memory than they fill.
class Bytes {
public:
    Bytes(const MatReader& reader, std::string_view data, bool compressed)
        : reader_(reader), data_(data), compressed_(compressed) {
        if (!compressed_) return;
        stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(data_.data()));
        stream_.avail_in = static_cast<uInt>(data_.size());
        if (inflateInit(&stream_) != Z_OK) throw reader_.damaged("a compressed element");
    }
    Bytes(const Bytes&) = delete;
    Bytes& operator=(const Bytes&) = delete;
    ~Bytes() {
        if (compressed_) inflateEnd(&stream_);
    }

    std::string take(std::size_t count) {
        if (!compressed_) {
            if (count > data_.size()) throw reader_.damaged("an element");
            const std::string taken(data_.substr(0, count));
            data_.remove_prefix(count);
            return taken;
        }
        std::string taken;
        while (taken.size() < count) {
            const std::size_t before = taken.size(),
                              step = std::min<std::size_t>(count - before, 1 << 20);
            taken.resize(before + step);
            stream_.next_out = reinterpret_cast<Bytef*>(&taken[before]);
            stream_.avail_out = static_cast<uInt>(step);
            inflate(&stream_, Z_SYNC_FLUSH);
            if (stream_.avail_out > 0) throw reader_.damaged("a compressed element");
        }
        return taken;
    }

    struct Part {
        std::uint32_t type = 0;
        std::size_t size = 0;
        std::optional<std::string> within;  // up to 4 bytes stand in the tag
    };
    Part tag() {
        const std::string bytes = take(kTag);
        const std::uint32_t first = reader_.word(bytes.data());
        if (first >> 16 == 0) return {first, reader_.word(&bytes[4]), std::nullopt};
        const std::size_t size = first >> 16;
        if (size > 4) throw reader_.damaged("an element");
        return {first & 0xffff, size, bytes.substr(4, size)};
    }
    /// An element that has to be of that type and at most that long.
    std::string part(std::uint32_t type, std::size_t most) {
        const Part part = tag();
        if (part.type != type || part.size > most) throw reader_.damaged("a variable");
        if (part.within) return *part.within;
        std::string data = take((part.size + 7) / 8 * 8);
        data.resize(part.size);
        return data;
    }

private:
    const MatReader& reader_;
    std::string_view data_;
    bool compressed_;
    z_stream stream_{};
};

/// The variable of that element, if it has that name.
std::optional<MatArray> read_variable(const MatReader& in, Bytes& bytes, const std::string& name) {
    const std::string flags = bytes.part(kUint32, 8);
    if (flags.size() != 8) throw in.damaged("a variable");
    const std::uint32_t array_class = in.word(flags.data()) & 0xff;
    if (array_class > kLastNumeric) return std::nullopt;  // of another make
    const std::string extents = bytes.part(kInt32, 4 * 32);
    if (bytes.part(kInt8, 1 << 10) != name) return std::nullopt;

    MatArray array;
    std::int64_t count = 1;
    for (std::size_t at = 0; at + 4 <= extents.size(); at += 4) {
        const std::int64_t extent = load<std::int32_t>(&extents[at], in.swap);
        if (extent < 0 || (extent > 0 && count > kMaxEntries / extent))
            throw in.wrong("'", name, "' has more than 2^28 entries");
        count *= extent;
        array.shape.push_back(extent);
    }
    const bool complex = in.word(flags.data()) >> 11 & 1;
    if (complex || array_class == kSparse)
        throw in.wrong("'", name, "' is complex or sparse; expected a full real array");
    if (array_class <= kText)
        throw in.wrong("'", name,
                       "' is no numeric array (a cell, a structure or text); expected numbers");
    if (array.shape.size() < 2) throw in.damaged("a shape");
    const Bytes::Part real = bytes.tag();
    const auto storage = std::find_if(std::begin(kStorages), std::end(kStorages),
                                      [&](const Storage& s) { return s.type == real.type; });
    if (storage == std::end(kStorages) ||
        real.size != storage->bytes * static_cast<std::size_t>(count))
        throw in.wrong("'", name, "' cannot be decoded: ", count, " entries in ", real.size,
                       " bytes; is the file damaged?");
    const std::string raw = real.within ? *real.within : bytes.take(real.size);
    array.numbers.resize(static_cast<std::size_t>(count));
    storage->widen(raw, in.swap, array.numbers);
    return array;
}

}  // namespace

MatArray read_mat_array(const std::string& path, const std::string& name) {
    const std::string file = read_bytes(path);
    MatReader in{path};
    if (file.starts_with("\x89HDF") || file.find("MATLAB 7.3") < kHeader)
        throw input_error("E_MAT_V73: ", path,
                          ": a MATLAB 7.3 (HDF5) file; save it anew with save('-v7', ...)");
    if (!file.starts_with("MATLAB 5.0"))
        throw in.wrong("not a MATLAB 5 to 7 file; expected 'MATLAB 5.0' at its start");
    if (file.size() < kHeader + kTag)
        throw in.wrong("cut off: ", file.size(), " bytes; copy the file again");
    const std::string_view order = std::string_view(file).substr(126, 2);
    if (order != "IM" && order != "MI") throw in.damaged("the byte order");
    in.swap = (order == "IM") != (std::endian::native == std::endian::little);
    for (std::size_t at = kHeader; at < file.size();) {
        const std::size_t left = file.size() - at;
        const std::uint32_t size = left < kTag ? 0 : in.word(&file[at + 4]);
        if (left < kTag || left - kTag < size)
            throw in.wrong("byte ", at, ": an element of ", size, " bytes, but only ", left,
                           " are left: the file is cut off; copy it again");
        const std::uint32_t type = in.word(&file[at]);
        Bytes bytes(in, std::string_view(file).substr(at + kTag, size), type == kCompressed);
        const bool is_variable =
            size > 0 && (type == kMatrix || (type == kCompressed && bytes.tag().type == kMatrix));
        if (is_variable)
            if (auto array = read_variable(in, bytes, name)) return *std::move(array);
        at += kTag + size;
    }
    throw in.wrong("holds no variable '", name, "'");
}

}  // namespace tvsgs
