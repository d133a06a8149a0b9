// Choice of the source views and of the depth range of each view.
#pragma once

#include <vector>

#include "core/math/vec.h"
#include "core/scene/camera.h"

namespace tvsgs {

/// Sources and depth range of one view.
struct ViewPlan {
    std::vector<int> sources;  // best first; empty: no other view overlaps
    float near_depth = 0, far_depth = 0;
};

/// Plans every view. A good source sees the same surface at an angle of about 5 degrees or more.
/// [MVSNet, A.2] A depth of 0 is replaced from the points, or from the point at which the cameras
/// look. Throws Error(ExitCode::input) if no view has a source, and if a depth is 0 and neither 20
/// points nor crossing axes determine it.
std::vector<ViewPlan> plan_views(const std::vector<Camera>& cameras,
                                 const std::vector<Vec3f>& points,
                                 float near_depth,
                                 float far_depth);

}  // namespace tvsgs
