// Measures the overlap of a run's photographs from its splats: which views share surface, and which
// surface a single view shows.
#pragma once

#include <vector>

#include "core/scene/gaussians.h"
#include "io/files/json_value.h"
#include "report/view_page.h"

namespace tvsgs {

inline constexpr std::size_t kMaxCoverageViews = 400;  // the time grows with their square

/// Uses the centres of opaque splats in a coarse depth buffer of each view. Returns
///   {"two": share of the surface in training views that at least two of them see,
///    "views": [{"name", "lone": share of the view that no other view sees,
///               "side": half of the view with most of that, "left", ..., or empty,
///               "partner": view that shares most with it, "shared"}],
///    "gap": {"a", "b", "angle_deg", "shared"}: the weakest link of the tree that joins all views
///           by the smallest angles between rays to shared points,
///    "test": [{"name", "nearest": training view with the smallest angle to the test view, measured
///              at the mean of the points that the test view sees, "angle_deg"}]}
/// Returns null where no training view sees a splat, and for more than kMaxCoverageViews training
/// views.
JsonValue coverage_json(const Gaussians<Cpu>& splats, const std::vector<ViewCamera>& cameras);

}  // namespace tvsgs
