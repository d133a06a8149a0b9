#include "mesh/tetrahedra/opacity_field_impl.h"
#include "render/tiles/tiles_cuda.h"

namespace tvsgs {
TVSGS_TILES_CUDA(FieldShape, RayGaussian<float>)
TVSGS_OPACITY_FIELD(Cuda)
}  // namespace tvsgs
