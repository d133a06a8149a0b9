// Reads the priors of a view for the terms.
#pragma once

#include <string_view>

#include "core/error.h"
#include "core/scene/prior_maps.h"
#include "optim/views/device_view.h"

namespace tvsgs {

/// [height width channels]; empty where the view has no such map. Throws Error(ExitCode::input)
/// where its size differs from the photograph's.
template <class Device>
Span<const float> prior_values(const DeviceView<Device>& view,
                               std::string_view name,
                               int channels = 1) {
    const DeviceMap<Device>* const map = view.map(name);
    if (map == nullptr) return {};
    const Camera& c = view.camera;
    if (map->width_px != c.width_px || map->height_px != c.height_px || map->channels != channels)
        throw Error(ExitCode::input, str("prior map '", name, "' of view ", view.index, " has ",
                                         map->width_px, " x ", map->height_px, " pixels of ",
                                         map->channels, " values; expected the photograph's ",
                                         c.width_px, " x ", c.height_px, " of ", channels));
    return map->values.span();
}

/// Neither NaN nor infinite.
TVSGS_HD inline bool is_number(float value) {
    return value * 0 == 0;
}

/// 1 for a view without a confidence map.
TVSGS_HD inline float confidence_at(Span<const float> confidence, int at) {
    return confidence.empty() ? 1.0f : confidence[at];
}

}  // namespace tvsgs
