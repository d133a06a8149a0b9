// Channel sets of splats: colour, and all maps of their surface. Kernels are compiled per set, so
// that unused maps cost nothing.
#pragma once

#include "render/backbone.h"

namespace tvsgs {

enum class Channels { color, color_plane, plane };

constexpr bool has_color(Channels channels) {
    return channels != Channels::plane;
}
constexpr bool has_plane(Channels channels) {
    return channels != Channels::color;
}

/// The smallest set that renders the maps. `plane`: maps that need more than colour.
constexpr Channels channels_of(Maps maps, Maps plane = kGeometryMaps) {
    return !has(maps, plane)        ? Channels::color
           : has(maps, Maps::color) ? Channels::color_plane
                                    : Channels::plane;
}

/// Calls run() as a template of the channels.
template <class Run>
void with_channels(Channels channels, const Run& run) {
    if (channels == Channels::color) return run.template operator()<Channels::color>();
    if (channels == Channels::plane) return run.template operator()<Channels::plane>();
    run.template operator()<Channels::color_plane>();
}

}  // namespace tvsgs
