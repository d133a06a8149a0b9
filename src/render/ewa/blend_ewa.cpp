#include "render/ewa/blend_ewa_packs.h"

namespace tvsgs {
TVSGS_TILES_CPU(SplatShape<float>, FeatureRecord)
TVSGS_BLEND_CPU(EwaModel<Channels::color>)
TVSGS_BLEND_CPU(EwaModel<Channels::color_plane>)
TVSGS_BLEND_CPU(EwaModel<Channels::plane>)
TVSGS_BLEND_BACK_CPU(PartedEwaModel<Channels::color>)
TVSGS_BLEND_BACK_CPU(PartedEwaModel<Channels::color_plane>)
}  // namespace tvsgs
