// WebP pictures, where libwebp was found when this was built.
#pragma once

#include <string>
#include <string_view>

#include "core/image.h"

namespace tvsgs {

inline constexpr int kWebpMaxSide = 16383;  // of the format

bool has_webp();

/// Of 3 channels, with losses; `quality` 1 to 100. Throws Error(ExitCode::usage) without libwebp.
std::string webp_bytes(const ImageU8& image, int quality);

inline bool is_webp(std::string_view bytes) {
    return bytes.starts_with("RIFF") && bytes.substr(0, 12).ends_with("WEBP");
}

/// Reads the start of a file; false where it is damaged. `channels` is 3 or 4. Throws
/// Error(ExitCode::input) without libwebp; `where`: what the message calls it.
bool read_webp_size(
    const std::string& where, std::string_view bytes, int& width, int& height, int& channels);

/// Decodes into `image`, of 3 or 4 channels and the size of the file; false where it is damaged.
bool decode_webp(std::string_view bytes, ImageU8& image);

}  // namespace tvsgs
