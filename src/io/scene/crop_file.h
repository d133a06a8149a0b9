// Reading of crop volumes for evaluation.
#pragma once

#include <string>

#include "core/scene/crop.h"

namespace tvsgs {

/// Reads a selection volume of Tanks and Temples, JSON with "box": [[x, y, z], [x, y, z]], or the
/// "crop_cylinder" of a scene's gt/info.json. Throws Error(ExitCode::input) that names the file and
/// the error in it.
Crop read_crop(const std::string& path);

}  // namespace tvsgs
