// Colours of the splats in view. A separate pass after projection; renders without colour skip it.
#pragma once

#include "render/backbone.h"
#include "render/tiles/sh_math.h"
#include "render/tiles/splat_places.h"

namespace tvsgs {

/// Viewpoint of the colours and degree of the SH.
struct ViewColors {
    Vec3f centre;  // of the camera, world
    int sh_degree;
};

template <class Record>
struct ColorBody {
    ViewColors view;
    Span<const Vec3f> means;
    const Vec3f* sh;  // coefficient major
    SplatPlaces places;
    Span<Record> features;

    TVSGS_HD void operator()(int i) const {
        const std::uint32_t at = places.of(i);
        if (at >= features.count) return;
        const Vec3f direction = normalize(means[i] - view.centre);
        features[at].f.color = sh_color<float>(view.sh_degree, direction, sh, means.count,
                                               static_cast<std::size_t>(i));
    }
};

}  // namespace tvsgs
