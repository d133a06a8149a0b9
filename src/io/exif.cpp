#include "io/exif.h"

#include <cstdint>

namespace tvsgs {
namespace {

/// Numbers of a text in either byte order; what lies beyond its end is 0.
struct Numbers {
    std::string_view bytes;
    bool big_endian;

    std::uint32_t at(std::size_t place, int size) const {
        std::uint32_t value = 0;
        if (place > bytes.size() || bytes.size() - place < static_cast<std::size_t>(size)) return 0;
        for (int i = 0; i < size; ++i)
            value = value << 8 |
                    static_cast<unsigned char>(
                        bytes[place + static_cast<std::size_t>(big_endian ? i : size - 1 - i)]);
        return value;
    }
};

/// Of a TIFF header with its first list of entries.
int orientation_of_tiff(std::string_view tiff) {
    if (!tiff.starts_with("MM") && !tiff.starts_with("II")) return 1;
    const Numbers in{tiff, tiff[0] == 'M'};
    const std::size_t list = in.at(4, 4), count = in.at(list, 2);
    for (std::size_t i = 0; i < count; ++i) {
        const std::size_t entry = list + 2 + 12 * i;  // tag, type, count, value
        if (in.at(entry, 2) != 0x0112) continue;
        const std::uint32_t value = in.at(entry + 8, 2);
        return value >= 1 && value <= 8 ? static_cast<int>(value) : 1;
    }
    return 1;
}

}  // namespace

int exif_orientation(std::string_view jpeg) {
    using std::string_view_literals::operator""sv;
    if (!jpeg.starts_with("\xFF\xD8")) return 1;
    const Numbers in{jpeg, true};
    // Segments, up to the one with which the pixels begin.
    for (std::size_t at = 2; in.at(at, 1) == 0xFF && in.at(at + 1, 1) != 0xDA;) {
        const std::size_t length = in.at(at + 2, 2);
        if (length < 2) return 1;
        const std::string_view segment = jpeg.substr(at, 2 + length);
        if (in.at(at + 1, 1) == 0xE1 && segment.substr(4).starts_with("Exif\0\0"sv))
            return orientation_of_tiff(segment.substr(10));
        at += 2 + length;
    }
    return 1;
}

ImageU8 turned(const ImageU8& image, int orientation) {
    ImageU8 out(image.height, image.width, image.channels);
    const bool from_right = orientation == 7 || orientation == 8,
               from_below = orientation == 6 || orientation == 7;
    for (int y = 0; y < out.height; ++y)
        for (int x = 0; x < out.width; ++x)
            for (int c = 0; c < out.channels; ++c)
                out.at(x, y, c) = image.at(from_right ? image.width - 1 - y : y,
                                           from_below ? image.height - 1 - x : x, c);
    return out;
}

}  // namespace tvsgs
