// WebP pictures, by libwebp.
#pragma once

#include <string>
#include <string_view>

#include "core/scene/image.h"

namespace tvsgs {

inline constexpr int kWebpMaxSide = 16383;  // of the format

/// Of 3 channels, with losses; `quality` 1 to 100.
std::string webp_bytes(const ImageU8& image, int quality);

/// Of 4 channels, every one as it is, also where alpha is 0.
std::string webp_lossless_bytes(const ImageU8& image);

inline bool is_webp(std::string_view bytes) {
    return bytes.starts_with("RIFF") && bytes.substr(0, 12).ends_with("WEBP");
}

/// Reads the start of a file; false where it is damaged. `channels` is 3 or 4.
bool read_webp_size(std::string_view bytes, int& width, int& height, int& channels);

/// Decodes into `image`, of 3 or 4 channels and the size of the file; false where it is damaged.
bool decode_webp(std::string_view bytes, ImageU8& image);

/// 4 channels of at most `max_pixels`. Throws Error(ExitCode::input) that names `where`.
ImageU8 decode_webp(std::string_view bytes, const std::string& where, std::int64_t max_pixels);

}  // namespace tvsgs
