// Which views to compare with which, and in which range of depths.
#pragma once

#include <vector>

#include "core/math/vec.h"
#include "core/scene/camera.h"

namespace tvsgs {

struct ViewPlan {
    std::vector<int> sources;  // best first; empty: no other view overlaps
    float near_depth = 0, far_depth = 0;
};

/// The plan of every view. A source is good when it sees what the view sees, under an angle of
/// about 5 degrees or more.  [MVSNet, A.2] A depth of 0 comes from the points, else from where the
/// cameras look. Throws Error(ExitCode::input) when no view has a source, and when a range is not
/// given and neither 20 points nor crossing axes tell it.
std::vector<ViewPlan> plan_views(const std::vector<Camera>& cameras,
                                 const std::vector<Vec3f>& points,
                                 float near_depth,
                                 float far_depth);

}  // namespace tvsgs
