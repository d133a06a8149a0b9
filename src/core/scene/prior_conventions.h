// Conventions of a prior's file: meaning of its numbers and frame of its normals.
// [docs/guide/priors.md#how-files-are-understood]
#pragma once

#include <string>

namespace tvsgs {

/// The quantity that equals scale * number + shift.
enum class PriorQuantity { unknown, depth, inverse_depth, log_depth };
/// z: along the optical axis; ray: along the ray of the pixel.
enum class PriorGeometry { unknown, z, ray };
/// The unknown part of scale and shift. metric: none; scale: the scale (for log depth, where the
/// unit is a shift, the shift); affine: both; rank: only the order of the numbers is right.
enum class PriorAlignment { metric, scale, affine, rank };

inline const char* name_of(PriorQuantity quantity) {
    constexpr const char* kNames[] = {"unknown", "depth", "inverse_depth", "log_depth"};
    return kNames[static_cast<int>(quantity)];
}
inline const char* name_of(PriorGeometry geometry) {
    constexpr const char* kNames[] = {"unknown", "z", "ray"};
    return kNames[static_cast<int>(geometry)];
}
inline const char* name_of(PriorAlignment alignment) {
    constexpr const char* kNames[] = {"metric", "scale", "affine", "rank"};
    return kNames[static_cast<int>(alignment)];
}

/// Convention of the depth maps of one source.
struct DepthConvention {
    PriorQuantity quantity = PriorQuantity::unknown;
    PriorGeometry geometry = PriorGeometry::unknown;
    PriorAlignment alignment = PriorAlignment::affine;
    /// Source of the convention, for messages. Empty: assumed from common practice; points may
    /// correct it.
    std::string declared_by;
};

/// Frame of the normals in a file.
enum class NormalFrame { camera_opencv, camera_opengl, world };

/// Convention of the normal maps of one source.
struct NormalConvention {
    NormalFrame frame = NormalFrame::camera_opencv;
    bool facing_away = false;
    std::string declared_by;  // as in DepthConvention
};

}  // namespace tvsgs
