// The parts of stb that tvsgs uses, with the same configuration in every source.
#pragma once

#define STBI_ONLY_JPEG
#define STBI_ONLY_PNG
#define STBI_ONLY_BMP
#define STBI_MAX_DIMENSIONS 65535  // [docs/method/input.md#sizes-of-photographs]
#include <stb/stb_image.h>
#include <stb/stb_image_write.h>
