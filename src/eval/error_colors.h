// Colours for points by their error.
#pragma once

#include <string>
#include <vector>

#include "core/math/vec.h"
#include "eval/dtu_protocol.h"

namespace tvsgs {

enum class ErrorPalette {
    dtu,   // white to red over 10 mm; green: outliers; blue: excluded
    tnt,   // matplotlib's "hot" reversed, over three thresholds
    safe,  // cividis, for colour-blind readers; orange: outliers; grey: excluded
};

/// RGB in [0, 1] for an error; `full` is the end of the scale. `dtu` and `safe` have separate
/// colours for outliers and excluded points; `tnt` shows outliers at the end of its scale.
Vec3f error_color(ErrorPalette palette, double error, double full, PointStatus status);

}  // namespace tvsgs
