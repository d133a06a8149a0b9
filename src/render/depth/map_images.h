// Conversion of rendered maps to images.
#pragma once

#include <vector>

#include "core/math/vec.h"
#include "core/scene/image.h"

namespace tvsgs {

/// Colours in [0, 1] to 8 bits, clamped and rounded half up; [H W] row by row.
ImageU8 color_image(int width, int height, const std::vector<Vec3f>& colors);

/// Camera-frame normals of any length as colours: surfaces that face the camera are blue, right is
/// red, up is green; pixels without a normal are black.
ImageU8 normal_image(int width, int height, const std::vector<Vec3f>& normals);

/// Depths from bright yellow (near) to dark violet (far), between the 1st and 99th percentile of
/// the valid depths; pixels without depth are black.
ImageU8 depth_image(int width, int height, const std::vector<float>& depths);

}  // namespace tvsgs
