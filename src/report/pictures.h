// Pictures and points of a report, small enough to live inside of one page.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/gaussians.h"
#include "core/image.h"
#include "core/scene.h"
#include "io/json_value.h"
#include "pipeline/train_evaluation.h"

namespace tvsgs {

std::string base64(const std::string& bytes);

/// {"src": data URI, "width", "height"}; at most `width` wide. JPEG.
JsonValue picture_json(const ImageU8& image, int width);

/// How far two pictures of one size are apart, mean over the channels; a quarter of the range and
/// more is the bright end.
ImageU8 difference_image(const ImageU8& a, const ImageU8& b);

/// From dark (none) to bright (all): cividis without its darkest part, to be seen on black.
struct Rgb {
    std::uint8_t r, g, b;
};
Rgb error_shade(double share);

/// The frame in which points are looked at first: x right, y up, z towards the viewer.
struct Viewpoint {
    Mat3f axes{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  // viewer_from_world
    float pitch = 0;                                // radians, the viewer's height
};

/// Upright as the cameras of cameras.json are, from the side of the middle one.
Viewpoint viewpoint_of(const JsonValue& cameras);

/// The splats' centres with their base colours.
PointCloud centres_of(const Gaussians<Cpu>& splats);

/// Where colours by error end: twice the largest threshold; 0: there is none.
double full_error(const Truth& truth);

/// At most 40,000 of the points (of those in the crop, where there is one) with their colours,
/// their distances to the truth where it is known, and a picture of them. Null without points.
JsonValue points_json(const PointCloud& points,
                      const std::optional<Truth>& truth,
                      const Viewpoint& viewpoint);

}  // namespace tvsgs
