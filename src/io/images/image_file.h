// Reading, writing and resizing of images; camera data of photographs from EXIF.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "core/scene/image.h"

namespace tvsgs {

/// Reads an 8-bit image with `channels` (1, 3, 4), or as in the file (0), from JPEG, PNG, BMP or
/// WebP. Scales 16-bit files to 8 bits, expands palettes and grey, and ignores the EXIF
/// orientation, like COLMAP. Throws Error(ExitCode::input) for unreadable or oversized files.
ImageU8 read_image(const std::string& path, int channels = 0);

inline constexpr std::int64_t kMaxPixels = std::int64_t{1} << 30;

/// The same for the bytes of a file with at most `max_pixels`. Messages contain `where`.
ImageU8 decode_image(const std::string& where,
                     std::string_view bytes,
                     int channels = 0,
                     std::int64_t max_pixels = kMaxPixels);

/// The numbers as stored in the file (0 to 255 or to 65535), with the file's channels. Throws like
/// read_image().
ImageF read_image_numbers(const std::string& path);

/// Extensions of supported files, in lower case, with the dot.
inline constexpr const char* kImageExtensions[] = {".png", ".jpg", ".jpeg", ".webp", ".bmp"};
bool has_image_extension(const std::string& path);

/// Reads width and height without decoding the pixels.
struct ImageSize {
    int width, height, channels;
};
ImageSize read_image_size(const std::string& path);

/// Encodes in memory. PNG: 1, 3 or 4 channels; JPEG: 1 or 3, `quality` 1 to 100.
std::string png_bytes(const ImageU8& image);
std::string jpeg_bytes(const ImageU8& image, int quality);
/// WebP: 3 channels, `quality` 1 to 100; or lossless, 4 channels, with the colour also where alpha
/// is 0.
std::string webp_bytes(const ImageU8& image, int quality);
std::string webp_lossless_bytes(const ImageU8& image);
inline constexpr int kWebpMaxSide = 16383;  // limit of the format

/// Reads the size from the start of a WebP file; 3 or 4 channels. Empty if the file is damaged.
std::optional<ImageSize> webp_size(std::string_view bytes);

/// Writes a PNG with 1, 3 or 4 channels as an atomic file.
void write_png(const std::string& path, const ImageU8& image);

/// Resizes like Pillow's default: anti-aliased bicubic (a = -0.5), rounded once at the end.
/// [docs/method/input.md#sizes-of-photographs]
ImageU8 resize_bicubic(const ImageU8& image, int width, int height);

/// Nearest neighbour; for masks.
ImageU8 resize_nearest(const ImageU8& image, int width, int height);

/// A place on Earth by WGS84: degrees to the north and to the east, and metres above the ellipsoid
/// or the sea.
struct GeodeticPlace {
    double latitude_deg = 0, longitude_deg = 0, height_m = 0;
};

/// Camera data of one photograph.
struct Exif {
    int orientation = 1;                 // 1 to 8
    std::string camera;                  // maker and model, or empty
    double focal_mm = 0;                 // 0: unknown
    std::optional<GeodeticPlace> place;  // of the camera; empty: unknown or without a height
};

/// Reads the first bytes of a JPEG, which must include the segments before the pixels. Never
/// throws; damaged entries keep their defaults.
Exif read_exif(std::string_view jpeg);

/// True for orientations that swap width and height.
inline bool swaps_sides(int orientation) {
    return orientation >= 5;
}

/// Clockwise quarter turns (0 to 3) that show a stored image upright; mirrored ones stay mirrored.
inline int upright_turns(int orientation) {
    constexpr int kTurns[] = {0, 0, 2, 2, 1, 1, 3, 3};
    return kTurns[orientation - 1];
}

/// The image as viewers show it, for orientations that swap width and height (5 to 8).
ImageU8 turned(const ImageU8& image, int orientation);

/// Turns by 0 or more quarter turns.
ImageU8 turned_clockwise(ImageU8 image, int quarters);

}  // namespace tvsgs
