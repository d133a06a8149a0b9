// Which way is up, as far as cameras tell.
#pragma once

#include <vector>

#include "core/scene/camera.h"

namespace tvsgs {

/// The turn of a scene, whose frame may be any, that makes it stand upright for viewers: +y up, and
/// what the middle one of `cameras` looks at seen from +z. Up is across the cameras' rows of
/// pixels, as people hold them level, on the side of their mean upward axis.
/// [docs/method/texture.md#upright]
Mat3<double> upright_from_scene(const std::vector<Camera>& cameras);

}  // namespace tvsgs
