// Computes a metric, upright frame from square markers of known size in several photographs.
// [docs/guide/photographs.md#markers]
#pragma once

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
    // metres; z up; the origin at the centre of the marker with the lowest number.
    Similarity to_new;
    int markers = 0;    // number of markers used
    double spread = 0;  // standard deviation of their sides, relative to the size
    // False: a marker deviates from the mean direction by 15 degrees or more, so only the scale is
    // used.
    bool upright = false;
};

/// `size`: side of a marker in metres. Markers lie on a floor (up is out of the paper) or hang on a
/// wall (up is up on the paper). A corner is the point nearest to its rays. Skips markers whose
/// rays differ by less than 2 degrees, and markers whose sides differ by more than a tenth. Throws
/// Error(ExitCode::input) if none is left.
MetricFrame metric_frame(const std::vector<MarkerView>& views, double size, bool on_wall);

}  // namespace tvsgs::prepare
