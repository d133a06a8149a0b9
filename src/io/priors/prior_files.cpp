#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "io/files/npz.h"
#include "io/files/number_types.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"
#include "io/priors/prior_sources.h"

namespace tvsgs {
namespace {

constexpr std::int64_t kMaxNumbers = std::int64_t{1} << 29;  // 2 GiB of float
constexpr int kMaxSide = 65535, kMaxChannels = 4096;

template <class... Parts>
Error prior_error(const std::string& path, const Parts&... parts) {
    return input_error("E_PRIOR_FILE: ", path, ": ", parts...);
}

/// A map whose size is valid and that `bytes` fill exactly.
ImageF sized_map(const std::string& path,
                 std::int64_t width,
                 std::int64_t height,
                 std::int64_t channels,
                 std::size_t bytes) {
    if (width < 1 || height < 1 || channels < 1 || width > kMaxSide || height > kMaxSide ||
        channels > kMaxChannels || width * height * channels > kMaxNumbers)
        throw prior_error(path, "claims ", width, "x", height, " pixels of ", channels,
                          " channels; expected 1 to ", kMaxSide,
                          " a side and at most 2^29 numbers");
    const auto numbers = static_cast<std::size_t>(width * height * channels);
    if (bytes != numbers * sizeof(float))
        throw prior_error(path, width, "x", height, " pixels of ", channels, " channels need ",
                          numbers * sizeof(float), " bytes, the file has ", bytes,
                          "; it may be cut off: copy it again");
    return {static_cast<int>(width), static_cast<int>(height), static_cast<int>(channels)};
}

static_assert(std::endian::native == std::endian::little);

/// Removes an integer and the character `end` from the front of `text`.
std::int64_t take_number(const std::string& path, std::string_view& text, char end) {
    const std::size_t at = text.substr(0, 12).find(end);
    std::int64_t value = 0;
    if (at == std::string_view::npos || !parse_number(text.substr(0, at), value))
        throw prior_error(path, "begins with '", shown(text),
                          "'; expected width&height&channels&, as COLMAP writes its maps");
    text.remove_prefix(at + 1);
    return value;
}

}  // namespace

ImageF read_pfm(const std::string& path) {
    const std::string bytes = read_bytes(path);
    std::string_view head = std::string_view(bytes).substr(0, 256);
    const std::string_view kind = next_word(head);
    std::int64_t width = 0, height = 0;
    double scale = 0;
    if ((kind != "Pf" && kind != "PF") || !parse_number(next_word(head), width) ||
        !parse_number(next_word(head), height) || !parse_number(next_word(head), scale) ||
        !std::isfinite(scale) || scale == 0 || head.empty())
        throw prior_error(path, "begins with '", shown(bytes),
                          "'; expected Pf or PF, width, height and a scale that is not 0");
    head.remove_prefix(1);  // one white space separates the header from the numbers
    const std::size_t begin = static_cast<std::size_t>(head.data() - bytes.data());
    ImageF map = sized_map(path, width, height, kind == "PF" ? 3 : 1, bytes.size() - begin);
    const char* from = bytes.data() + begin;
    for (int y = map.height - 1; y >= 0; --y)
        for (int i = 0; i < map.width * map.channels; ++i, from += sizeof(float)) {
            const auto bits = load<std::uint32_t>(from);
            (&map.at(0, y))[i] = std::bit_cast<float>(scale < 0 ? bits : __builtin_bswap32(bits));
        }
    return map;
}

ImageF read_dmb(const std::string& path) {
    const std::string bytes = read_bytes(path);
    constexpr std::size_t kHead = 16;
    std::int32_t head[4] = {};
    if (bytes.size() >= kHead) std::memcpy(head, bytes.data(), kHead);
    if (head[0] != 1)
        throw prior_error(path, "of ", bytes.size(), " bytes begins with type ", head[0],
                          "; expected 1 (float32), height, width and channels");
    ImageF map = sized_map(path, head[2], head[1], head[3], bytes.size() - kHead);
    std::memcpy(map.pixels.data(), bytes.data() + kHead, bytes.size() - kHead);
    return map;
}

ImageF read_colmap_map(const std::string& path) {
    const std::string bytes = read_bytes(path);
    std::string_view rest = bytes;
    const std::int64_t width = take_number(path, rest, '&'), height = take_number(path, rest, '&'),
                       channels = take_number(path, rest, '&');
    ImageF map = sized_map(path, width, height, channels, rest.size());
    const char* from = rest.data();
    for (int c = 0; c < map.channels; ++c)
        for (int y = 0; y < map.height; ++y)
            for (int x = 0; x < map.width; ++x, from += sizeof(float))
                map.at(x, y, c) = load<float>(from);
    return map;
}

ImageF read_npy_map(const std::string& path, int channels, MapLayout layout) {
    const NpyArray array = read_npy(path);
    std::vector<std::int64_t> shape;
    for (const std::int64_t n : array.shape)
        if (n != 1 || array.shape.size() <= 2) shape.push_back(n);
    const auto wrong = [&] {
        return prior_error(path, "an array of shape (", joined(array.shape), "); expected ",
                           channels == 1   ? "(height, width)"
                           : channels == 0 ? "(channels, height, width)"
                                           : str("(height, width, ", channels, ") or (", channels,
                                                 ", height, width)"));
    };
    if (array.is_text || shape.size() < 2 || shape.size() > 3) throw wrong();
    // Descriptors of one channel and maps of one row may lack an axis.
    bool first = false;
    std::int64_t count = 1;
    if (shape.size() == 3) {
        first = layout == MapLayout::chw ||
                (layout == MapLayout::automatic && (channels == 0 || shape[2] != channels));
        count = first ? shape[0] : shape[2];
        shape.erase(first ? shape.begin() : shape.begin() + 2);
    }
    if (channels > 0 && count != channels) throw wrong();
    ImageF map = sized_map(path, shape[1], shape[0], count, array.numbers.size() * sizeof(float));
    const std::size_t pixels = array.numbers.size() / static_cast<std::size_t>(count);
    for (std::size_t i = 0; i < array.numbers.size(); ++i) {
        const std::size_t to =
            first ? i % pixels * static_cast<std::size_t>(count) + i / pixels : i;
        map.pixels[to] = static_cast<float>(array.numbers[i]);
    }
    return map;
}

ImageF read_picture_map(const std::string& path, int channels) {
    ImageF picture = read_image_numbers(path);
    if (channels == 0 || picture.channels == channels) return picture;
    const bool too_few = picture.channels < 3;
    ImageF map(picture.width, picture.height, channels);
    const auto from = static_cast<std::size_t>(picture.channels),
               to = static_cast<std::size_t>(channels);
    for (std::size_t i = 0; i < picture.pixels.size() / from; ++i) {
        const float* const pixel = &picture.pixels[from * i];
        if (channels == 1 ? !too_few && (pixel[0] != pixel[1] || pixel[0] != pixel[2]) : too_few)
            throw prior_error(path, channels == 1 ? "a coloured picture; expected grey: save the "
                                                    "map without a colour map, best as .npy"
                                                  : "a grey picture; expected three channels");
        std::copy_n(pixel, to, &map.pixels[to * i]);
    }
    return map;
}

ImageF read_prior_map(const std::string& path, int channels, MapLayout layout) {
    const std::string ending = std::filesystem::path(path).extension().string();
    if (ending == ".npy") return read_npy_map(path, channels, layout);
    if (ending == ".png" || ending == ".jpg") return read_picture_map(path, channels);
    if (ending != ".pfm" && ending != ".dmb" && ending != ".bin")
        throw prior_error(path, "ends in '", shown(ending),
                          "'; expected .npy, .png, .pfm, .dmb or .bin: save it as .npy");
    ImageF map = ending == ".pfm"   ? read_pfm(path)
                 : ending == ".dmb" ? read_dmb(path)
                                    : read_colmap_map(path);
    if (channels > 0 && map.channels != channels)
        throw prior_error(path, map.channels, " channels; expected ", channels);
    return map;
}

}  // namespace tvsgs
