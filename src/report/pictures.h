// Pictures and points of a report, small enough to live inside of one page.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/scene/gaussians.h"
#include "core/scene/image.h"
#include "core/scene/scene.h"
#include "io/files/json_value.h"
#include "pipeline/run/train_evaluation.h"

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

/// Where colours by error end: twice the largest threshold; 0: there is none.
double full_error(const Truth& truth);

}  // namespace tvsgs
