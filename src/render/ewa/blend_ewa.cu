#include "render/ewa/blend_ewa.h"
#include "render/tiles/blend_cuda.h"
#include "render/tiles/tiles_cuda.h"

namespace tvsgs {
TVSGS_TILES_CUDA(SplatShape<float>, FeatureRecord)
TVSGS_BLEND_CUDA(EwaModel<Channels::color>)
TVSGS_BLEND_CUDA(EwaModel<Channels::color_plane>)
TVSGS_BLEND_CUDA(EwaModel<Channels::plane>)
TVSGS_BLEND_BACK_CUDA(PartedEwaModel<Channels::color>)
TVSGS_BLEND_BACK_CUDA(PartedEwaModel<Channels::color_plane>)
}  // namespace tvsgs
