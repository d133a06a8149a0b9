// Ground control points: surveyed points that are marked in photographs.
// [docs/guide/photographs.md#true-scale-and-place]
#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "apps/prepare/photographs.h"
#include "apps/prepare/placement.h"
#include "apps/prepare/sparse_model.h"
#include "io/scene/control_list.h"

namespace tvsgs::prepare {

struct ControlPoints {
    ControlList list;                   // positions in metres; images by their names in the scene
    std::set<std::string> checkpoints;  // names of points that are not fitted
};

/// Reads the list and checks all that is known before COLMAP: converts degrees to a local frame,
/// finds the photographs of the marks. `checkpoints`: names with commas. Throws
/// Error(ExitCode::input) for an unknown photograph, a mark outside of it, two marks of a point in
/// one photograph, fewer than 3 points to fit that have two marks, and points on one line;
/// Error(ExitCode::usage) for an unknown checkpoint.
ControlPoints read_control_points(const std::string& path,
                                  const std::vector<Photograph>& photographs,
                                  const std::string& checkpoints);

/// A control point in the frame of the model.
struct FoundPoint {
    std::optional<Vec3d> position;   // empty: fewer than two marks meet
    std::vector<int> used, dropped;  // lines of the marks; dropped: off by more than the limit
    double residual_px = 0;          // RMS of the used marks
    double pixel = 0;                // width of a pixel at the point, units of the model
};

/// Finds the point at which the rays of most marks meet. A pair of marks proposes a point; a mark
/// supports it if it is off by at most 0.3 % of the longer side of its photograph. Ignores marks in
/// photographs without a pose.
FoundPoint find_point(const SparseModel& model, const ControlPoint& point);

/// Fits the model to the control points and logs the residual of each.
GeoFrame place_by_control_points(const SparseModel& model, const ControlPoints& points);

}  // namespace tvsgs::prepare
