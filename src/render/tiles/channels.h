// Channel sets of planar splats. Kernels are compiled per set, so that unused maps cost nothing.
#pragma once

#include "render/backbone.h"

namespace tvsgs {

/// With _ray, depth comes from the splats along rays and not from blended planes. Blending treats
/// it like the set without _ray.
enum class Channels { color, color_plane, plane, color_ray, ray };

constexpr bool has_color(Channels channels) {
    return channels != Channels::plane && channels != Channels::ray;
}
constexpr bool has_plane(Channels channels) {
    return channels != Channels::color;
}
constexpr bool has_ray(Channels channels) {
    return channels == Channels::color_ray || channels == Channels::ray;
}

/// The set that blending uses.
constexpr Channels blended(Channels channels) {
    return !has_ray(channels)    ? channels
           : has_color(channels) ? Channels::color_plane
                                 : Channels::plane;
}
constexpr Channels along_rays(Channels channels) {
    return !has_plane(channels)  ? channels
           : has_color(channels) ? Channels::color_ray
                                 : Channels::ray;
}

/// The smallest set that renders the maps.
constexpr Channels channels_of(Maps maps) {
    return !has(maps, kGeometryMaps) ? Channels::color
           : has(maps, Maps::color)  ? Channels::color_plane
                                     : Channels::plane;
}

/// Calls run() as a template of the channels.
template <class Run>
void with_channels(Channels channels, const Run& run) {
    switch (channels) {
        case Channels::color:
            return run.template operator()<Channels::color>();
        case Channels::color_plane:
            return run.template operator()<Channels::color_plane>();
        case Channels::plane:
            return run.template operator()<Channels::plane>();
        case Channels::color_ray:
            return run.template operator()<Channels::color_ray>();
        case Channels::ray:
            return run.template operator()<Channels::ray>();
    }
}

/// For splats that blend all geometry maps or none: calls run() as a template of <maps, colour>.
/// Without maps there is always colour.
template <class Run>
void with_maps(bool maps, bool color, const Run& run) {
    if (!maps) return run.template operator()<false, true>();
    color ? run.template operator()<true, true>() : run.template operator()<true, false>();
}

}  // namespace tvsgs
