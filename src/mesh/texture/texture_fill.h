// Fills the pixels of a texture.
#pragma once

#include "mesh/texture/texture_charts.h"
#include "mesh/texture/texture_level.h"

namespace tvsgs::texture {

inline constexpr Vec3f kGrey{0.5f, 0.5f, 0.5f};  // of faces without a colour

/// Texels from the corner of the chart's rectangle.
Vec2<double> place_in(const Chart& chart, double scale, const Projection& p);

/// Draws charts with their corrections, and tiles, on a background of one colour.
ImageU8 fill_texture(const TriangleMesh& mesh,
                     const std::vector<PhotoView>& views,
                     const Atlas& atlas,
                     const std::vector<Correction>& corrections,
                     Vec3f ground,
                     Sights& sights);

}  // namespace tvsgs::texture
