// Reading of camera data from EXIF.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "core/scene/image.h"

namespace tvsgs {

/// A place on Earth by WGS84: degrees to the north and to the east, and metres above the ellipsoid
/// or the sea.
struct GeodeticPlace {
    double latitude_deg = 0, longitude_deg = 0, height_m = 0;
};

/// Camera data of one photograph.
struct Exif {
    int orientation = 1;                 // 1 to 8
    std::string camera;                  // maker and model, or empty
    double focal_mm = 0;                 // 0: unknown
    std::optional<GeodeticPlace> place;  // of the camera; empty: unknown or without a height
};

/// Reads the first bytes of a JPEG, which must include the segments before the pixels. Never
/// throws; damaged entries keep their defaults.
Exif read_exif(std::string_view jpeg);

/// True for orientations that swap width and height.
inline bool swaps_sides(int orientation) {
    return orientation >= 5;
}

/// The image as viewers show it, for orientations that swap width and height (5 to 8).
ImageU8 turned(const ImageU8& image, int orientation);

}  // namespace tvsgs
