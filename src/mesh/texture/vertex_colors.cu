#include "mesh/texture/vertex_colors.h"

namespace tvsgs {

void add_colors(const DepthView<Cuda>& view,
                const Buffer<Vec3f, Cuda>& vertices,
                Buffer<ColorSum, Cuda>& sums) {
    parallel_for(Cuda{}, static_cast<int>(vertices.size()),
                 AddColorBody{view.camera, view.depth, view.color, vertices.span(), sums.span()});
}

}  // namespace tvsgs
