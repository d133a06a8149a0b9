#include "mesh/texture/vertex_colors.h"

namespace tvsgs {

void add_colors(const DepthView<Cpu>& view,
                const Buffer<Vec3f, Cpu>& vertices,
                Buffer<ColorSum, Cpu>& sums) {
    parallel_for(Cpu{}, static_cast<int>(vertices.size()),
                 AddColorBody{view.camera, view.depth, view.color, vertices.span(), sums.span()});
}

}  // namespace tvsgs
