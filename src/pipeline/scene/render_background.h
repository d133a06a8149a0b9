// Composites renders over the background of a run.
#pragma once

#include <vector>

#include "core/error.h"
#include "optim/losses/losses_list.h"
#include "render/backbone.h"

namespace tvsgs {

/// [H W] The colours of `images`, which have a transmittance, over the background; a random
/// background counts as black.
template <class Images>
std::vector<Vec3f> colors_over_background(const PhotometricOptions& options,
                                          const Camera& camera,
                                          const Images& images) {
    std::vector<Vec3f> colors = to_host(images.color);
    const PhotoBackground background = parse_background(options.background);
    const bool is_sky = background.kind == PhotoBackground::Kind::sky;
    if (is_sky && !options.sky) throw Error(ExitCode::usage, kSkyNeedsMap);
    if (background.black() && !is_sky) return colors;
    const Behind behind{background.linear(),
                        is_sky ? SkyMap{options.sky->pixels.data(), options.sky->width} : SkyMap{},
                        camera};
    const std::vector<float> T = to_host(images.transmittance);
    parallel_for(Cpu{}, static_cast<int>(colors.size()),
                 [&](int i) { colors[i] += T[i] * behind.at(i); });
    return colors;
}

}  // namespace tvsgs
