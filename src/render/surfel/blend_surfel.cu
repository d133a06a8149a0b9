#include "render/surfel/blend_surfel.h"
#include "render/tiles/blend_cuda.h"
#include "render/tiles/tiles_cuda.h"

namespace tvsgs {
TVSGS_TILES_CUDA(SurfelShape<float>, SurfelRecord)
TVSGS_BLEND_CUDA(SurfelModel<false>)
TVSGS_BLEND_CUDA(SurfelModel<true>)
TVSGS_BLEND_BACK_CUDA(PartedSurfelModel<false>)
TVSGS_BLEND_BACK_CUDA(PartedSurfelModel<true>)
}  // namespace tvsgs
