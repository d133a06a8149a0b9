#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <vector>

#include "io/files/read_file.h"
#include "io/images/image_file.h"

namespace tvsgs {
namespace {

/// Reads numbers of either byte order; 0 beyond the end of the text.
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

/// A TIFF with lists of entries: tag, type, count, and the value or its offset.
struct Tiff {
    Numbers in;

    /// Offset of the value of a tag; 0 if there is none. `size`: bytes of the value.
    std::size_t find(std::size_t list, std::uint32_t tag, std::size_t& size) const {
        const std::size_t count = in.at(list, 2);
        for (std::size_t i = 0; i < count; ++i) {
            const std::size_t entry = list + 2 + 12 * i;
            if (in.at(entry, 2) != tag) continue;
            constexpr std::size_t kSizes[] = {0, 1, 1, 2, 4, 8};  // text, short, long, rational
            const std::uint32_t type = in.at(entry + 2, 2);
            if (type >= std::size(kSizes)) return 0;
            size = kSizes[type] * in.at(entry + 4, 4);
            return size <= 4 ? entry + 8 : in.at(entry + 8, 4);
        }
        return 0;
    }
    std::string text(std::size_t list, std::uint32_t tag) const {
        std::size_t size = 0;
        const std::size_t at = find(list, tag, size);
        if (at == 0 || at >= in.bytes.size()) return "";
        const std::string_view all = in.bytes.substr(at, std::min<std::size_t>(size, 64));
        return std::string(trimmed(all.substr(0, all.find('\0'))));
    }
    /// The `count` rationals of a tag; empty if there are not as many, or one has no value.
    std::vector<double> rationals(std::size_t list, std::uint32_t tag, std::size_t count) const {
        std::size_t size = 0;
        const std::size_t at = find(list, tag, size);
        std::vector<double> out;
        for (std::size_t i = 0; at != 0 && size == 8 * count && i < count; ++i) {
            const double below = in.at(at + 8 * i + 4, 4);
            if (below == 0) return {};
            out.push_back(in.at(at + 8 * i, 4) / below);
        }
        return out;
    }
};

/// The place in the list of GPS data. Cameras without a fix write zeros.
std::optional<GeodeticPlace> read_place(const Tiff& tiff, std::size_t list) {
    const std::vector<double> latitude = tiff.rationals(list, 2, 3),
                              longitude = tiff.rationals(list, 4, 3),
                              height = tiff.rationals(list, 6, 1);
    const std::string north = tiff.text(list, 1), east = tiff.text(list, 3);
    if (latitude.empty() || longitude.empty() || height.empty()) return std::nullopt;
    if ((north != "N" && north != "S") || (east != "E" && east != "W")) return std::nullopt;
    const auto degrees = [](const std::vector<double>& dms, bool negative) {
        return (dms[0] + dms[1] / 60 + dms[2] / 3600) * (negative ? -1 : 1);
    };
    std::size_t size = 0;
    const std::size_t below = tiff.find(list, 5, size);  // 1 and 3: below the surface
    const bool negative = below != 0 && tiff.in.at(below, 1) % 2 == 1;
    const GeodeticPlace place{degrees(latitude, north == "S"), degrees(longitude, east == "W"),
                              negative ? -height[0] : height[0]};
    if (place.latitude_deg == 0 && place.longitude_deg == 0) return std::nullopt;
    if (!(std::abs(place.latitude_deg) <= 90 && std::abs(place.longitude_deg) <= 180))
        return std::nullopt;
    return place;
}

Exif read_tiff(std::string_view bytes) {
    Exif exif;
    if (!bytes.starts_with("MM") && !bytes.starts_with("II")) return exif;
    const Tiff tiff{{bytes, bytes[0] == 'M'}};
    const Numbers& in = tiff.in;
    const std::size_t list = in.at(4, 4);
    std::size_t size = 0;
    if (const std::size_t at = tiff.find(list, 0x0112, size))
        if (const std::uint32_t value = in.at(at, 2); value >= 1 && value <= 8)
            exif.orientation = static_cast<int>(value);
    exif.camera = trimmed(tiff.text(list, 0x010F) + " " + tiff.text(list, 0x0110));
    if (const std::size_t details = tiff.find(list, 0x8769, size))
        if (const std::size_t at = tiff.find(in.at(details, 4), 0x920A, size))
            if (const double of = in.at(at + 4, 4); of > 0) exif.focal_mm = in.at(at, 4) / of;
    if (const std::size_t gps = tiff.find(list, 0x8825, size))
        exif.place = read_place(tiff, in.at(gps, 4));
    return exif;
}

}  // namespace

Exif read_exif(std::string_view jpeg) {
    using std::string_view_literals::operator""sv;
    if (!jpeg.starts_with("\xFF\xD8")) return {};
    const Numbers in{jpeg, true};
    // Reads the segments before the pixels.
    for (std::size_t at = 2; in.at(at, 1) == 0xFF && in.at(at + 1, 1) != 0xDA;) {
        const std::size_t length = in.at(at + 2, 2);
        if (length < 2) return {};
        const std::string_view segment = jpeg.substr(at, 2 + length);
        if (in.at(at + 1, 1) == 0xE1 && segment.substr(4).starts_with("Exif\0\0"sv))
            return read_tiff(segment.substr(10));
        at += 2 + length;
    }
    return {};
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

ImageU8 turned_clockwise(ImageU8 image, int quarters) {
    constexpr int kQuarter = 6;  // EXIF orientation
    for (; quarters > 0; --quarters) image = turned(image, kQuarter);
    return image;
}

}  // namespace tvsgs
