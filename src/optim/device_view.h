#pragma once

#include "core/camera.h"
#include "core/scene.h"
#include "render/backbone.h"

namespace tvsgs {

/// A training view on the device.
template <class Device>
struct DeviceView {
    int index = 0;  // among the training views
    Camera camera;
    Buffer<std::uint8_t, Device> photo;  // [H W 3]
    float edge_min = 0, edge_max = 1;    // range of the photo's edge strength, for the normal loss
    int grey_width = 0, grey_height = 0;
    Buffer<std::uint8_t, Device> grey;  // [grey_height grey_width] for matching patches; or empty
};

}  // namespace tvsgs
