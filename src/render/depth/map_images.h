// Rendered maps as pictures for people.
#pragma once

#include <vector>

#include "core/math/vec.h"
#include "core/scene/image.h"

namespace tvsgs {

/// Colours in [0, 1] to 8 bits, rounded half up and clamped; [H W] row by row.
ImageU8 color_image(int width, int height, const std::vector<Vec3f>& colors);

/// Camera-frame normals of any length as colours: facing surfaces are blue, right red, up green;
/// none is black.
ImageU8 normal_image(int width, int height, const std::vector<Vec3f>& normals);

/// Near is bright yellow, far dark violet, between the 1st and 99th percentile of the valid depths;
/// none is black.
ImageU8 depth_image(int width, int height, const std::vector<float>& depths);

}  // namespace tvsgs
