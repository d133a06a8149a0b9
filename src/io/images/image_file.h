// Photographs and pictures on disk.
#pragma once

#include <string>
#include <string_view>

#include "core/scene/image.h"

namespace tvsgs {

/// 8-bit with `channels` (1, 3, 4) or as in the file (0). 16-bit files are scaled; palettes and
/// grey are expanded; EXIF orientation is ignored, as COLMAP does. JPEG, PNG, BMP and WebP. Throws
/// Error(ExitCode::input) for unreadable or oversized files.
ImageU8 read_image(const std::string& path, int channels = 0);

inline constexpr std::int64_t kMaxPixels = std::int64_t{1} << 30;

/// The same for the bytes of such a file of up to so many pixels; `where`: what messages call it.
ImageU8 decode_image(const std::string& where,
                     std::string_view bytes,
                     int channels = 0,
                     std::int64_t max_pixels = kMaxPixels);

/// The numbers as they are in the file, 0 to 255 or to 65535, in its channels. Throws as
/// read_image.
ImageF read_image_numbers(const std::string& path);

/// Extensions of these files, in lower case, with the dot.
inline constexpr const char* kImageExtensions[] = {".png", ".jpg", ".jpeg", ".webp", ".bmp"};
bool has_image_extension(const std::string& path);

/// Width and height without decoding the pixels.
struct ImageSize {
    int width, height, channels;
};
ImageSize read_image_size(const std::string& path);

/// Encoded in memory: 1, 3 or 4 channels; 1 or 3 with `quality` 1 to 100.
std::string png_bytes(const ImageU8& image);
std::string jpeg_bytes(const ImageU8& image, int quality);

/// PNG with 1, 3 or 4 channels; temporary file, flushed, renamed.
void write_png(const std::string& path, const ImageU8& image);

/// Pillow's default: anti-aliased bicubic (a = -0.5), rounded once at the end.
/// [docs/method/input.md#sizes-of-photographs]
ImageU8 resize_bicubic(const ImageU8& image, int width, int height);

/// Nearest neighbour; for masks.
ImageU8 resize_nearest(const ImageU8& image, int width, int height);

}  // namespace tvsgs
