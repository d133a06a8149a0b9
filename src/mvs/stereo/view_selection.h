// Choice of the source views and of the depth range of each view, and the points that it sees.
#pragma once

#include <vector>

#include "core/math/vec.h"
#include "core/scene/camera.h"

namespace tvsgs {

/// Sources and depth range of one view.
struct ViewPlan {
    std::vector<int> sources;    // best first; empty: no other view overlaps
    std::vector<float> weights;  // of the sources: 1 up to 45 degrees, falls to 0 at 75
    float near_depth = 0, far_depth = 0;
};

/// Depth ranges of all views, without sources. A depth of 0 is replaced from the points, or from
/// the point at which the cameras look. Throws Error(ExitCode::input) if a depth is 0 and neither
/// 20 points nor crossing axes determine it.
std::vector<ViewPlan> plan_ranges(const std::vector<Camera>& cameras,
                                  const std::vector<Vec3f>& points,
                                  float near_depth,
                                  float far_depth);

/// Adds sources to the ranges. A good source sees the same surface at an angle of about 5 degrees
/// or more. [MVSNet, A.2] A view with two sources up to 60 degrees gets none beyond. Throws like
/// plan_ranges(), and if no view has a source.
std::vector<ViewPlan> plan_views(const std::vector<Camera>& cameras,
                                 const std::vector<Vec3f>& points,
                                 float near_depth,
                                 float far_depth);

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
