// A training view in device memory, and the names of the maps that terms use.
#pragma once

#include <set>
#include <string_view>
#include <vector>

#include "core/scene/camera.h"
#include "render/backbone.h"

namespace tvsgs {

using MapNames = std::set<std::string_view>;

/// A ViewMap on the device.
template <class Device>
struct DeviceMap {
    std::string_view name;
    int width_px = 0, height_px = 0, channels = 1;
    Buffer<float, Device> values;  // [height width channels]; empty: this view has no such map
};

/// Mean over the channels of the absolute difference of two pixels of a photograph [H W 3], 0 to 1.
TVSGS_HD inline float color_difference(const std::uint8_t* photo, int p, int q) {
    int sum = 0;
    for (int c = 0; c < 3; ++c) {
        const int d = photo[3 * p + c] - photo[3 * q + c];
        sum += d < 0 ? -d : d;
    }
    return float(sum) / (3 * 255);
}

/// Edge strength of an interior pixel: the larger central difference of both axes, 0 to 1.
TVSGS_HD inline float edge_strength(const std::uint8_t* photo, int width, int x, int y) {
    const int at = y * width + x;
    const float horizontal = color_difference(photo, at + 1, at - 1),
                vertical = color_difference(photo, at + width, at - width);
    return horizontal > vertical ? horizontal : vertical;
}

template <class Device>
struct DeviceView {
    int index = 0;  // among the training views
    Camera camera;
    Buffer<std::uint8_t, Device> photo;  // [H W 3]
    float edge_min = 0, edge_max = 1;    // range of edge_strength() in the photograph
    int grey_width = 0, grey_height = 0;
    Buffer<std::uint8_t, Device> grey;    // [grey_height grey_width] for patch matching; or empty
    std::vector<DeviceMap<Device>> maps;  // maps that terms use

    /// Returns null where this view has no such map.
    const DeviceMap<Device>* map(std::string_view name) const {
        for (const DeviceMap<Device>& m : maps)
            if (m.name == name) return m.values.empty() ? nullptr : &m;
        return nullptr;
    }
};

}  // namespace tvsgs
