#include "io/files/npz.h"

#include <bit>
#include <cstring>

#include "io/files/half.h"
#include "io/files/read_file.h"
#include "io/files/zip_archive.h"

namespace tvsgs {
namespace {

constexpr std::int64_t kMaxShapeEntry = std::int64_t(1) << 31;
constexpr std::uint64_t kMaxEntryBytes = ZipLimits{}.entry_bytes;

[[noreturn]] void fail(const std::string& name, const std::string& what) {
    throw Error(ExitCode::input,
                str(name, ": ", what, "; save it again with numpy.save or numpy.savez"));
}

/// The header {'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }: exactly these keys, in
/// any order.
struct Header {
    std::string descr;
    bool fortran_order = false;
    std::vector<std::int64_t> shape;
};

class HeaderParser {
public:
    HeaderParser(std::string_view text, const std::string& name) : text_(text), name_(name) {}

    Header parse() {
        Header header;
        unsigned seen = 0;
        expect('{');
        while (peek() != '}') {
            const std::string key = quoted();
            expect(':');
            if (key == "descr") {
                if (peek() == '[') fail(name_, "structured arrays are not supported");
                header.descr = quoted(), seen |= 1;
            } else if (key == "fortran_order") {
                header.fortran_order = boolean(), seen |= 2;
            } else if (key == "shape") {
                header.shape = tuple(), seen |= 4;
            } else {
                fail(name_, str("unknown key '", key, "' in the header"));
            }
            if (peek() == ',') ++at_;
        }
        ++at_;
        if (seen != 7) fail(name_, "the header lacks descr, fortran_order or shape");
        return header;
    }

private:
    char peek() {
        while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\n')) ++at_;
        if (at_ >= text_.size()) fail(name_, "the header ends early");
        return text_[at_];
    }
    void expect(char c) {
        if (peek() != c)
            fail(name_, str("expected '", c, "' in the header, found '", text_[at_], "'"));
        ++at_;
    }
    std::string quoted() {
        const char quote = peek();
        if (quote != '\'' && quote != '"') fail(name_, "expected a quoted word in the header");
        const std::size_t end = text_.find(quote, ++at_);
        if (end == std::string_view::npos) fail(name_, "unclosed quote in the header");
        const std::string word(text_.substr(at_, end - at_));
        at_ = end + 1;
        return word;
    }
    bool boolean() {
        peek();
        for (const auto& [word, value] :
             {std::pair{std::string_view("True"), true}, {"False", false}})
            if (text_.substr(at_, word.size()) == word) {
                at_ += word.size();
                return value;
            }
        fail(name_, "fortran_order: expected True or False");
    }
    std::vector<std::int64_t> tuple() {
        std::vector<std::int64_t> shape;
        expect('(');
        while (peek() != ')') {
            std::int64_t value = 0;
            const std::size_t start = at_;
            for (; at_ < text_.size() && text_[at_] >= '0' && text_[at_] <= '9'; ++at_) {
                value = value * 10 + (text_[at_] - '0');
                if (value >= kMaxShapeEntry) fail(name_, "a dimension is 2^31 or larger");
            }
            if (at_ == start || shape.size() >= 32)
                fail(name_, "shape is not a tuple of up to 32 numbers");
            shape.push_back(value);
            if (peek() == ',') ++at_;
        }
        ++at_;
        return shape;
    }

    std::string_view text_;
    const std::string& name_;
    std::size_t at_ = 0;
};

template <class T>
T load(const char* bytes, bool swap) {
    char raw[sizeof(T)];
    for (std::size_t i = 0; i < sizeof(T); ++i) raw[i] = bytes[swap ? sizeof(T) - 1 - i : i];
    T value;
    std::memcpy(&value, raw, sizeof(T));
    return value;
}

double number(char kind, std::size_t size, const char* bytes, bool swap) {
    switch (kind * 16 + static_cast<int>(size)) {
        case 'f' * 16 + 2:
            return half_to_double(load<std::uint16_t>(bytes, swap));
        case 'f' * 16 + 4:
            return static_cast<double>(load<float>(bytes, swap));
        case 'f' * 16 + 8:
            return load<double>(bytes, swap);
        case 'i' * 16 + 1:
            return load<std::int8_t>(bytes, swap);
        case 'i' * 16 + 2:
            return load<std::int16_t>(bytes, swap);
        case 'i' * 16 + 4:
            return load<std::int32_t>(bytes, swap);
        case 'i' * 16 + 8:
            return static_cast<double>(load<std::int64_t>(bytes, swap));
        case 'b' * 16 + 1:
        case 'u' * 16 + 1:
            return load<std::uint8_t>(bytes, swap);
        case 'u' * 16 + 2:
            return load<std::uint16_t>(bytes, swap);
        case 'u' * 16 + 4:
            return load<std::uint32_t>(bytes, swap);
        default:
            return static_cast<double>(load<std::uint64_t>(bytes, swap));
    }
}

bool known_type(char kind, std::size_t size) {
    if (kind == 'f') return size == 2 || size == 4 || size == 8;
    if (kind == 'i' || kind == 'u') return size == 1 || size == 2 || size == 4 || size == 8;
    return kind == 'b' && size == 1;
}

void append_utf8(std::string& text, std::uint32_t c) {
    const auto byte = [&text](std::uint32_t value) { text += static_cast<char>(value); };
    if (c < 0x80) {
        byte(c);
    } else if (c < 0x800) {
        byte(0xc0 | c >> 6), byte(0x80 | (c & 63));
    } else if (c < 0x10000) {
        byte(0xe0 | c >> 12), byte(0x80 | (c >> 6 & 63)), byte(0x80 | (c & 63));
    } else {
        byte(0xf0 | (c >> 18 & 7)), byte(0x80 | (c >> 12 & 63)), byte(0x80 | (c >> 6 & 63)),
            byte(0x80 | (c & 63));
    }
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
    constexpr bool kBigHost = std::endian::native == std::endian::big;
    const std::size_t length = long_header ? load<std::uint32_t>(bytes.data() + 8, kBigHost)
                                           : load<std::uint16_t>(bytes.data() + 8, kBigHost);
    if (bytes.size() - start < length) fail(name, "the file ends inside the header");
    const Header header = HeaderParser(bytes.substr(start, length), name).parse();
    const std::string_view data = bytes.substr(start + length);

    const std::string& d = header.descr;
    if (d.size() < 3 || d.size() > 8 ||
        std::string_view("<>|=").find(d[0]) == std::string_view::npos ||
        d.find_first_not_of("0123456789", 2) != std::string::npos)
        fail(name, str("unsupported type '", d, "'"));
    const char kind = d[1];
    const std::size_t size = std::stoul(d.substr(2)) * (kind == 'U' ? 4 : 1);
    const bool text = kind == 'U' && header.shape.empty();
    if (!text && !known_type(kind, size))
        fail(name, str("unsupported type '", d,
                       "'; expected a float of 16 to 64 bits, an integer or bool"));

    NpyArray array{header.shape, {}, {}, text};
    std::size_t count = 1;
    for (const std::int64_t extent : header.shape) {
        const auto n = static_cast<std::size_t>(extent);
        if (n != 0 && count > kMaxEntryBytes / n) fail(name, "the shape exceeds 1 GiB");
        count *= n;
    }
    if (data.size() != count * size)
        fail(name,
             str("the shape needs ", count * size, " bytes of data, the file has ", data.size()));
    const bool swap = d[0] == '>' ? !kBigHost : d[0] == '<' ? kBigHost : false;
    if (text) {
        for (std::size_t i = 0; i < size; i += 4)
            if (const auto c = load<std::uint32_t>(data.data() + i, swap); c != 0)
                append_utf8(array.text, c);
        return array;
    }
    array.numbers.resize(count);
    for (std::size_t i = 0; i < count; ++i)
        array.numbers[header.fortran_order ? row_major(i, header.shape) : i] =
            number(kind, size, data.data() + i * size, swap);
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
    std::string names;
    for (const auto& [there, array] : archive) names += (names.empty() ? "" : ", ") + there;
    throw Error(ExitCode::input, str("no array '", name, "' in the archive; it has ", names));
}

}  // namespace tvsgs
