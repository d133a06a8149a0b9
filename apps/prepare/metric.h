// A metric, upright frame from square markers of known size that several photographs see.
// [docs/guide/photographs.md#markers]
#pragma once

#include <string>
#include <vector>

#include "apps/prepare/opencv.h"
#include "apps/prepare/sparse_model.h"

namespace tvsgs::prepare {

struct MarkerView {
    Intrinsics camera;
    Rigid3d camera_from_world;
    std::vector<Marker> markers;
};

struct MetricFrame {
    Similarity to_new;     // metres; z up; the origin in the middle of the marker of lowest number
    int markers = 0;       // that were used
    double spread = 0;     // standard deviation of their sides, as a share of the size
    bool upright = false;  // false: one is 15 degrees off their mean or more; units alone change
};

/// `size`: side of a marker in metres. Markers lie on a floor (up is out of the paper), or hang on
/// a wall (up is up on the paper). A corner is the point nearest to its rays; markers that two
/// photographs do not see from directions at least 2 degrees apart, or whose sides differ by more
/// than a tenth, do not count. Throws Error(ExitCode::input) where none is left.
MetricFrame metric_frame(const std::vector<MarkerView>& views, double size, bool on_wall);

}  // namespace tvsgs::prepare
