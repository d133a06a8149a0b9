// Decides whether surfaces far behind the scene's centre are meshed.  [docs/guide/plan.md]
#pragma once

#include <vector>

#include "core/scene/camera.h"
#include "plan/decision.h"

namespace tvsgs {

/// Share of the points, of those in two or more images, that a bounded mesh would leave out: at
/// or beyond its depth limit (MeshOptions::depth_max of 0) in all of these images. NaN: no two
/// images show a point, or the cameras look at no common point.
double share_beyond(const std::vector<Camera>& cameras, const std::vector<Vec3f>& points);

/// `masked`: the share is of the points inside masks, because nothing outside is meshed.
Decision decide_background(double share_beyond, bool masked = false);

}  // namespace tvsgs
