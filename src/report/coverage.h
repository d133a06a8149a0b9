// What the photographs of a run see of its splats, and from where: what one view alone has seen.
#pragma once

#include <vector>

#include "core/scene/gaussians.h"
#include "io/files/json_value.h"
#include "report/view_page.h"

namespace tvsgs {

inline constexpr std::size_t kMaxCoverageViews = 400;  // pairs of them are looked at

/// By the centres of opaque splats in a coarse depth buffer of each view:
///   {"two": share of what the training views show that two of them see,
///    "views": [{"name", "lone": share of the view that no other sees, "side": where most of that
///               lies, "left", ..., or empty, "partner": who shares most with it, "shared"}],
///    "gap": {"a", "b", "angle_deg", "shared"}: the weakest link of the chain that joins all views
///           by the smallest angles between the rays to what two of them see,
///    "test": [{"name", "nearest": the training view from where the angle to it is smallest, seen
///              from the middle of what it shows, "angle_deg"}]}
/// Null where no training view sees a splat, and of more than kMaxCoverageViews training views.
JsonValue coverage_json(const Gaussians<Cpu>& splats, const std::vector<ViewCamera>& cameras);

}  // namespace tvsgs
