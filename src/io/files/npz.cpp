#include "io/files/npz.h"

#include <bit>
#include <ranges>

#include "io/files/atomic_file.h"
#include "io/files/json_file.h"
#include "io/files/number_types.h"
#include "io/files/zip_archive.h"

namespace tvsgs {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::uint64_t kMaxShapeEntry = (std::uint64_t{1} << 31) - 1;
constexpr std::uint64_t kMaxEntryBytes = ZipLimits{}.entry_bytes;

template <class... Parts>
[[noreturn]] void fail(const std::string& name, const Parts&... what) {
    throw Error(ExitCode::input, name, ": ", what...,
                "; save it again with numpy.save or numpy.savez");
}

struct Header {
    std::string descr;
    bool fortran_order = false;
    std::vector<std::int64_t> shape;
};

/// The header {'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }: exactly these keys, in
/// any order. Reads it as JSON, after a change of quotes, brackets, words and last commas.
Header parse_header(std::string_view text, const std::string& name) {
    std::string json;
    for (const char c : text) {
        if (c == ')' || c == '}')
            while (json.ends_with(',') || json.ends_with(' ')) json.pop_back();
        constexpr std::string_view kFrom = "'()TF", kTo = "\"[]tf";
        const std::size_t at = kFrom.find(c);
        json += at == kFrom.npos ? c : kTo[at];
    }
    const nlohmann::json found = parse_json(json, name);
    if (!found.is_object()) fail(name, "the header is no dictionary of Python, or ends early");
    for (const auto& [key, value] : found.items())
        if (key != "descr" && key != "fortran_order" && key != "shape")
            fail(name, "unknown key '", shown(key), "' in the header");
    if (found.size() != 3) fail(name, "the header lacks descr, fortran_order or shape");
    if (found["descr"].is_array()) fail(name, "structured arrays are not supported");
    const nlohmann::json& shape = found["shape"];
    if (!found["descr"].is_string() || !found["fortran_order"].is_boolean() || !shape.is_array() ||
        shape.size() > 32)
        fail(name,
             "expected text as descr, True or False as fortran_order, up to 32 numbers as shape");
    Header header{found["descr"], found["fortran_order"], {}};
    for (const nlohmann::json& extent : shape) {
        if (!extent.is_number_unsigned()) fail(name, "shape is not a tuple of up to 32 numbers");
        if (extent.get<std::uint64_t>() > kMaxShapeEntry)
            fail(name, "a dimension is 2^31 or larger");
        header.shape.push_back(extent);
    }
    return header;
}

/// Row-major position of the entry at `position` in Fortran order.
std::size_t row_major(std::size_t position, const std::vector<std::int64_t>& shape) {
    std::size_t result = 0, stride = 1;
    for (const std::int64_t extent : shape) stride *= static_cast<std::size_t>(extent);
    for (const std::int64_t extent : shape) {
        const auto n = static_cast<std::size_t>(extent);
        stride /= n;
        result += position % n * stride;
        position /= n;
    }
    return result;
}

}  // namespace

std::int64_t NpyArray::size() const {
    std::int64_t product = 1;
    for (const std::int64_t extent : shape) product *= extent;
    return product;
}

NpyArray parse_npy(std::string_view bytes, const std::string& name) {
    constexpr std::string_view kMagic("\x93NUMPY", 6);
    if (bytes.size() < 10 || bytes.substr(0, 6) != kMagic)
        fail(name, "not a .npy array (wrong signature)");
    const bool long_header = bytes[6] != 1;
    const std::size_t start = long_header ? 12 : 10;
    if (bytes[6] < 1 || bytes[6] > 3) fail(name, "unknown version of the .npy format");
    if (bytes.size() < start) fail(name, "the file ends inside the header");
    const std::size_t length =
        long_header ? load<std::uint32_t>(bytes.data() + 8) : load<std::uint16_t>(bytes.data() + 8);
    if (bytes.size() - start < length) fail(name, "the file ends inside the header");
    const Header header = parse_header(bytes.substr(start, length), name);
    std::string_view data = bytes.substr(start + length);

    const std::string& d = header.descr;
    if (d.size() < 3 || d.size() > 8 ||
        std::string_view("<>|=").find(d[0]) == std::string_view::npos ||
        d.find_first_not_of("0123456789", 2) != std::string::npos)
        fail(name, "unsupported type '", d, "'");
    const bool text = d[1] == 'U' && header.shape.empty();
    const std::size_t size = std::stoul(d.substr(2)) * (text ? 4 : 1);
    const NumberType* const type = find_number_type(d[1], size);
    if (!text && !type)
        fail(name, "unsupported type '", d,
             "'; expected a float of 16 to 64 bits, an integer or bool");

    NpyArray array{header.shape, {}, {}, text};
    std::size_t count = 1;
    for (const std::int64_t extent : header.shape) {
        const auto n = static_cast<std::size_t>(extent);
        if (n != 0 && count > kMaxEntryBytes / n) fail(name, "the shape exceeds 1 GiB");
        count *= n;
    }
    if (data.size() != count * size)
        fail(name, "the shape needs ", count * size, " bytes of data, the file has ", data.size());
    std::string swapped;
    if (const std::size_t unit = text ? 4 : size; d[0] == '>') {
        swapped = data;
        for (auto at = swapped.begin(); at != swapped.end();
             at += static_cast<std::ptrdiff_t>(unit))
            std::reverse(at, at + static_cast<std::ptrdiff_t>(unit));
        data = swapped;
    }
    if (text) {
        for (std::size_t i = 0; i < size; i += 4)
            if (const auto c = load<std::uint32_t>(data.data() + i); c != 0)
                array.text += c < 0x80 ? static_cast<char>(c) : '?';
        return array;
    }
    array.numbers.resize(count);
    for (std::size_t i = 0; i < count; ++i)
        array.numbers[header.fortran_order ? row_major(i, header.shape) : i] =
            type->load(data.data() + i * size);
    return array;
}

NpyArray read_npy(const std::string& path) {
    return parse_npy(read_bytes(path), path);
}

NpzArchive read_npz(const std::string& path) {
    NpzArchive archive;
    read_zip(path, ".npz", {}, [&](const std::string& name, const std::string& bytes) {
        const std::string where = str(path, ": ", name);
        if (!name.ends_with(".npy")) fail(where, "the name does not end in .npy");
        archive.emplace(name.substr(0, name.size() - 4), parse_npy(bytes, where));
    });
    return archive;
}

const NpyArray& find_array(const NpzArchive& archive, const std::string& name) {
    if (const auto found = archive.find(name); found != archive.end()) return found->second;
    throw input_error("no array '", name, "' in the archive; it has ",
                      joined(std::views::keys(archive)));
}

void write_npy(const std::string& path,
               const std::vector<std::int64_t>& shape,
               const float* numbers) {
    std::string dimensions;
    std::size_t count = 1;
    for (const std::int64_t n : shape) {
        dimensions += std::to_string(n) + ",";
        count *= static_cast<std::size_t>(n);
    }
    std::string header =
        "{'descr': '<f4', 'fortran_order': False, 'shape': (" + dimensions + "), }";
    // Magic, version and length take 10 bytes; the data must begin at a multiple of 64.
    header += std::string(63 - (10 + header.size()) % 64, ' ') + "\n";
    AtomicFile file(path);
    file.write(std::string_view("\x93NUMPY\x01\x00", 8));
    const char length[2] = {static_cast<char>(header.size() & 255),
                            static_cast<char>(header.size() >> 8)};
    file.write(length, 2);
    file.write(header);
    file.write(numbers, count * sizeof(float));
    file.commit();
}

}  // namespace tvsgs
