// Which points of a cloud a view sees, where no track says so.
#pragma once

#include <vector>

#include "core/scene/camera.h"

namespace tvsgs {

struct VisiblePoint {
    int index;          // in the cloud
    double x_px, y_px;  // from the corner of the first pixel
    double depth;       // z, world units
    double distance;    // along the ray
};

/// Points in the picture that no other of their neighbourhood hides: a z-buffer of cells that hold
/// about eight points, where one counts if it is at most 5 % farther than the nearest. Where the
/// cloud is thin, points behind the surface get through.
std::vector<VisiblePoint> visible_points(const Camera& camera, const std::vector<Vec3f>& points);

}  // namespace tvsgs
