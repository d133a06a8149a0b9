#include "render/rade/blend_rade.h"

#include "render/ewa/blend_ewa_packs.h"

namespace tvsgs {
TVSGS_TILES_CPU(SplatShape<float>, RadeRecord)
TVSGS_BLEND_CPU(RadeModel<false>)
TVSGS_BLEND_CPU(RadeModel<true>)
}  // namespace tvsgs
