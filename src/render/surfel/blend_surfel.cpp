#include "render/surfel/blend_surfel.h"

#include "render/tiles/blend_cpu.h"
#include "render/tiles/tiles_cpu.h"

namespace tvsgs {
TVSGS_TILES_CPU(SurfelShape<float>, SurfelRecord)
TVSGS_BLEND_CPU(SurfelModel<false>)
TVSGS_BLEND_CPU(SurfelModel<true>)
TVSGS_BLEND_BACK_CPU(PartedSurfelModel<false>)
TVSGS_BLEND_BACK_CPU(PartedSurfelModel<true>)
}  // namespace tvsgs
