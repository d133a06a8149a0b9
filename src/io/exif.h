// How a camera was held, as EXIF says.
#pragma once

#include <string_view>

#include "core/image.h"

namespace tvsgs {

/// EXIF orientation of a JPEG, 1 to 8; 1 where none is said. Never throws: what is broken says
/// nothing.
int exif_orientation(std::string_view jpeg);

/// Of orientations that swap the sides.
inline bool turns_sides(int orientation) {
    return orientation >= 5;
}

/// The image as viewers show it, for orientations that swap the sides (5 to 8).
ImageU8 turned(const ImageU8& image, int orientation);

}  // namespace tvsgs
