#pragma once

#include <string>

#include "core/scene/crop.h"

namespace tvsgs {

/// A Tanks-and-Temples selection volume, JSON with "box": [[x, y, z], [x, y, z]], or the
/// "crop_cylinder" of a scene's gt/info.json. Throws Error(ExitCode::input) that names the file and
/// what is wrong in it.
Crop read_crop(const std::string& path);

}  // namespace tvsgs
