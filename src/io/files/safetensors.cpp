#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "io/files/json_value.h"
#include "io/files/npz.h"
#include "io/files/number_types.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

static_assert(std::endian::native == std::endian::little, "the format is little-endian");

constexpr std::uint64_t kMaxHeader = 100'000'000;  // bytes; limit of the format's own reader

/// A non-negative integer of the header.
std::uint64_t whole(const JsonValue& value, const std::string& where) {
    if (!value.is(JsonValue::Kind::number) || !(value.number >= 0 && value.number < 9e15) ||
        value.number != std::floor(value.number))
        throw input_error(where, ": expected whole numbers in shape and data_offsets");
    return static_cast<std::uint64_t>(value.number);
}

}  // namespace

NpzArchive read_safetensors(const std::string& path) {
    const std::string bytes = read_bytes(path);
    const auto damaged = [&](const auto&... what) {
        return input_error(path, ": ", what..., "; expected a complete safetensors or .npz file");
    };
    std::uint64_t length = 0;
    if (bytes.size() < 8) throw damaged(bytes.size(), " bytes");
    std::memcpy(&length, bytes.data(), 8);
    if (length > kMaxHeader || length > bytes.size() - 8)
        throw damaged("the header claims ", length, " bytes, the file has ", bytes.size());
    const std::string_view data = std::string_view(bytes).substr(8 + length);
    const JsonValue header = parse_json_value(std::string_view(bytes).substr(8, length), path);

    NpzArchive archive;
    std::vector<std::pair<std::uint64_t, std::uint64_t>> ranges;
    for (const auto& [name, entry] : header.members) {
        if (name == "__metadata__") continue;
        const std::string where = str(path, ": tensor ", shown(name));
        const std::string dtype = entry["dtype"].text;
        const auto* const type = std::ranges::find_if(kNumberTypes, [&](const NumberType& t) {
            return t.kind == 'f' && dtype == str('F', 8 * t.bytes);
        });
        if (type == std::end(kNumberTypes))
            throw input_error(where, " has type ", shown(dtype), "; expected F16, F32 or F64");
        const auto& offsets = entry["data_offsets"].items;
        if (offsets.size() != 2) throw damaged("tensor ", shown(name), " has no data_offsets");
        const std::uint64_t begin = whole(offsets[0], where), end = whole(offsets[1], where);
        if (begin > end || end > data.size())
            throw damaged("tensor ", shown(name), " lies at bytes ", begin, " to ", end, " of ",
                          data.size());
        NpyArray array;
        std::uint64_t count = 1;
        for (const JsonValue& extent : entry["shape"].items) {
            const std::uint64_t n = whole(extent, where);
            if (n > 0 && count > data.size() / n)
                throw damaged("tensor ", shown(name), " is larger than the file");
            count *= n;
            array.shape.push_back(static_cast<std::int64_t>(n));
        }
        if (count * type->bytes != end - begin)
            throw damaged("tensor ", shown(name), " has ", count, " numbers in ", end - begin,
                          " bytes");
        array.numbers.resize(count);
        for (std::uint64_t i = 0; i < count; ++i)
            array.numbers[i] = type->load(data.data() + begin + i * type->bytes);
        if (begin < end) ranges.emplace_back(begin, end);
        archive.emplace(name, std::move(array));
    }
    std::ranges::sort(ranges);
    for (std::size_t i = 1; i < ranges.size(); ++i)
        if (ranges[i].first < ranges[i - 1].second) throw damaged("tensors overlap");
    return archive;
}

NpzArchive read_tensors(const std::string& path) {
    const std::string bytes = read_bytes(path);
    return bytes.starts_with("PK") ? read_npz(path) : read_safetensors(path);
}

}  // namespace tvsgs
