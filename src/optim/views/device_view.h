// A training view in device memory, and the names of the maps that terms use.
#pragma once

#include <algorithm>
#include <array>
#include <initializer_list>
#include <string_view>
#include <vector>

#include "core/scene/camera.h"
#include "core/scene/scene.h"
#include "render/backbone.h"

namespace tvsgs {

/// Set of map names of a view, at most eight.
class MapNames {
public:
    constexpr MapNames() = default;
    constexpr MapNames(std::initializer_list<std::string_view> names) {
        for (const std::string_view name : names) add(name);
    }
    constexpr void add(std::string_view name) {
        if (std::find(begin(), end(), name) == end())
            names_.at(static_cast<std::size_t>(count_++)) = name;
    }
    constexpr const std::string_view* begin() const { return names_.data(); }
    constexpr const std::string_view* end() const { return names_.data() + count_; }
    constexpr bool empty() const { return count_ == 0; }

private:
    std::array<std::string_view, 8> names_{};
    int count_ = 0;
};

/// A ViewMap on the device.
template <class Device>
struct DeviceMap {
    std::string_view name;
    int width_px = 0, height_px = 0, channels = 1;
    Buffer<float, Device> values;  // [height width channels]; empty: this view has no such map
};

/// A training view on the device.
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
