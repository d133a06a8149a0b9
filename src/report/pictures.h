// Makes pictures for a report, small enough to embed in a page.
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

/// {"src": data URI of a JPEG, "width", "height"}; at most `width` wide.
JsonValue picture_json(const ImageU8& image, int width);

/// Difference of two pictures of one size, averaged over the channels; a quarter of the range or
/// more is the brightest shade.
ImageU8 difference_image(const ImageU8& a, const ImageU8& b);

/// Colours from dark (no error) to bright (full error): cividis without its darkest part, for a
/// black background.
struct Rgb {
    std::uint8_t r, g, b;
};
Rgb error_shade(double share);

/// End of the error colour scale: twice the largest threshold; 0: no threshold.
double full_error(const Truth& truth);

}  // namespace tvsgs
