// Reading of lists of ground control points: gcp_list.txt of OpenDroneMap.
// [docs/guide/photographs.md#true-scale-and-place]
#pragma once

#include <string>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs {

/// Place of a control point in a photograph.
struct ControlMark {
    std::string image;   // name or path
    Vec2<double> place;  // pixels, right and down from the upper left corner
    int line = 0;        // of the list
};

/// A surveyed point. Names are unique; a point without a name is called "line N", by its first
/// mark.
struct ControlPoint {
    std::string name;
    Vec3d position;  // in the projection of the list
    std::vector<ControlMark> marks;
};

struct ControlList {
    std::string path;
    std::string projection;            // EPSG:n, or a PROJ string
    bool degrees = false;              // x, y are longitude and latitude
    std::vector<ControlPoint> points;  // in the order of the file
};

/// Reads a line with the projection, then lines `x y z px py image [name]`; skips empty lines and
/// lines that begin with '#'. Lines with one name, or one position without a name, are marks of one
/// point. Throws Error(ExitCode::input) with the line.
ControlList read_control_list(const std::string& path);

}  // namespace tvsgs
