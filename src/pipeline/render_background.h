// Renders as a run has them scored: with its background behind the splats.
#pragma once

#include <vector>

#include "optim/photo_background.h"
#include "render/backbone.h"

namespace tvsgs {

/// [H W] The colours of `images`, which have a transmittance; a random background counts as black.
template <class Images>
std::vector<Vec3f> colors_before(const PhotoBackground& behind, const Images& images) {
    std::vector<Vec3f> colors = to_host(images.color);
    if (behind.kind == PhotoBackground::Kind::constant && !behind.black()) {
        const std::vector<float> T = to_host(images.transmittance);
        for (std::size_t i = 0; i < colors.size(); ++i) colors[i] += T[i] * behind.linear();
    }
    return colors;
}

}  // namespace tvsgs
