// What a photograph says of its camera.
#pragma once

#include <string>
#include <string_view>

#include "core/scene/image.h"

namespace tvsgs {

struct Exif {
    int orientation = 1;  // 1 to 8
    std::string camera;   // maker and model, or empty
    double focal_mm = 0;  // 0: not said
};

/// Of the start of a JPEG that holds its segments before the pixels. Never throws: what is broken
/// says nothing.
Exif read_exif(std::string_view jpeg);

/// Of orientations that swap the sides.
inline bool turns_sides(int orientation) {
    return orientation >= 5;
}

/// The image as viewers show it, for orientations that swap the sides (5 to 8).
ImageU8 turned(const ImageU8& image, int orientation);

}  // namespace tvsgs
