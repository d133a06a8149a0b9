// Visibility of a cloud's points in a view, for clouds without tracks.
#pragma once

#include <vector>

#include "core/scene/camera.h"

namespace tvsgs {

/// A visible point and its place in the view.
struct VisiblePoint {
    int index;          // in the cloud
    double x_px, y_px;  // from the corner of the first pixel
    double depth;       // z, world units
    double distance;    // along the ray
};

/// Points in the image that no nearby point hides: a z-buffer with cells of about eight points
/// keeps a point if it is at most 5 % farther than the nearest. Where the cloud is sparse, points
/// behind the surface may pass.
std::vector<VisiblePoint> visible_points(const Camera& camera, const std::vector<Vec3f>& points);

}  // namespace tvsgs
