#include "render/rade/blend_rade.h"
#include "render/tiles/blend_cuda.h"
#include "render/tiles/tiles_cuda.h"

namespace tvsgs {
TVSGS_TILES_CUDA(SplatShape<float>, RadeRecord)
TVSGS_BLEND_CUDA(RadeModel<false>)
TVSGS_BLEND_CUDA(RadeModel<true>)
}  // namespace tvsgs
