// Reading and writing of WebP images by libwebp.
#pragma once

#include <string>
#include <string_view>

#include "core/scene/image.h"

namespace tvsgs {

inline constexpr int kWebpMaxSide = 16383;  // limit of the format

/// Lossy WebP of an image with 3 channels; `quality` 1 to 100.
std::string webp_bytes(const ImageU8& image, int quality);

/// Lossless WebP of an image with 4 channels. Keeps the colour also where alpha is 0.
std::string webp_lossless_bytes(const ImageU8& image);

inline bool is_webp(std::string_view bytes) {
    return bytes.starts_with("RIFF") && bytes.substr(0, 12).ends_with("WEBP");
}

/// Reads the size from the start of a file; `channels` becomes 3 or 4. Returns false if the file is
/// damaged.
bool read_webp_size(std::string_view bytes, int& width, int& height, int& channels);

/// Decodes into `image`, which must have the file's size and 3 or 4 channels. Returns false if the
/// file is damaged.
bool decode_webp(std::string_view bytes, ImageU8& image);

}  // namespace tvsgs
