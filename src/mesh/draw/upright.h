// Finds the upright orientation of a scene from its cameras.
#pragma once

#include <vector>

#include "core/scene/camera.h"

namespace tvsgs {

/// Rotation of a scene (in any frame) that makes it stand upright in viewers: +y is up, and the
/// middle one of `cameras` looks from +z. Up is perpendicular to the cameras' pixel rows, because
/// people hold cameras level, on the side of the mean upward axis. [docs/method/texture.md#upright]
Mat3<double> upright_from_scene(const std::vector<Camera>& cameras);

}  // namespace tvsgs
