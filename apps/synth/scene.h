// Writes a synthetic scene: photographs, cameras, initial points, masks, priors, the exact surface.
#pragma once

#include <string>

#include "apps/synth/views.h"

namespace tvsgs::synth {

/// Writes to the folder `out`, which must exist. The same options give the same files.
void write_scene(const SynthOptions& options, const std::string& out);

}  // namespace tvsgs::synth
