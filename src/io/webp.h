// WebP pictures, where libwebp was found when this was built.
#pragma once

#include <string>

#include "core/image.h"

namespace tvsgs {

inline constexpr int kWebpMaxSide = 16383;  // of the format

bool has_webp();

/// Of 3 channels, with losses; `quality` 1 to 100. Throws Error(ExitCode::usage) without libwebp.
std::string webp_bytes(const ImageU8& image, int quality);

}  // namespace tvsgs
