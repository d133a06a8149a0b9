// How a file of a prior is meant: what its numbers are, and in which frame its normals stand.
// [docs/guide/priors.md#how-files-are-understood]
#pragma once

#include <string>

namespace tvsgs {

/// What scale times number plus shift is.
enum class PriorQuantity { unknown, depth, inverse_depth, log_depth };
/// Along the optical axis, or along the ray.
enum class PriorGeometry { unknown, z, ray };
/// What is not known of scale and shift. `scale`: of log depth, an unknown unit is the shift.
/// `rank`: the order alone is right.
enum class PriorAlignment { metric, scale, affine, rank };

inline const char* name_of(PriorQuantity quantity) {
    return quantity == PriorQuantity::inverse_depth ? "inverse_depth"
           : quantity == PriorQuantity::log_depth   ? "log_depth"
           : quantity == PriorQuantity::depth       ? "depth"
                                                    : "unknown";
}
inline const char* name_of(PriorGeometry geometry) {
    return geometry == PriorGeometry::ray ? "ray" : geometry == PriorGeometry::z ? "z" : "unknown";
}
inline const char* name_of(PriorAlignment alignment) {
    return alignment == PriorAlignment::metric   ? "metric"
           : alignment == PriorAlignment::scale  ? "scale"
           : alignment == PriorAlignment::affine ? "affine"
                                                 : "rank";
}

struct DepthConvention {
    PriorQuantity quantity = PriorQuantity::unknown;
    PriorGeometry geometry = PriorGeometry::unknown;
    PriorAlignment alignment = PriorAlignment::affine;
    /// Who says so, for messages; empty: what such files usually are, and points may know better.
    std::string declared_by;
};

enum class NormalFrame { camera_opencv, camera_opengl, world };

struct NormalConvention {
    NormalFrame frame = NormalFrame::camera_opencv;
    bool facing_away = false;
    std::string declared_by;  // as above
};

}  // namespace tvsgs
