#include "mesh/tetrahedra/opacity_field_impl.h"
#include "render/tiles/tiles_cuda.h"

namespace tvsgs {

TVSGS_TILES_CUDA(FieldShape, RayGaussian<float>)

void see_points(const FieldSplats<Cuda>& splats,
                const FieldViews& views,
                const Buffer<Vec3f, Cuda>& points,
                Buffer<Sight, Cuda>& sights) {
    detail::FieldScratch<Cuda> scratch;
    detail::see_points_on(splats, views, points, scratch, sights);
}

void find_crossings(const FieldSplats<Cuda>& splats,
                    const FieldViews& views,
                    int steps,
                    Buffer<Vec3f, Cuda>& free_ends,
                    Buffer<Vec3f, Cuda>& inside_ends) {
    detail::find_crossings_on(splats, views, steps, free_ends, inside_ends);
}

}  // namespace tvsgs
