#include "render/blend_cuda.h"
#include "render/blend_ewa.h"
#include "render/tiles_cuda.h"

namespace tvsgs {
TVSGS_TILES_CUDA(SplatShape<float>, FeatureRecord)
TVSGS_BLEND_CUDA(EwaModel<Channels::color>)
TVSGS_BLEND_CUDA(EwaModel<Channels::color_plane>)
TVSGS_BLEND_CUDA(EwaModel<Channels::plane>)
}  // namespace tvsgs
