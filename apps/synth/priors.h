// Writes priors of a synthetic scene in the formats of other programs: exact, or wrong on request.
#pragma once

#include <string>

#include "apps/synth/views.h"
#include "core/scene/mesh.h"

namespace tvsgs::synth {

/// The formats of --priors.
inline const std::vector<std::string> kPriorFormats{"npy",    "vggt", "params",   "colmap",
                                                    "mvsnet", "acmm", "omnidata", "json"};

/// Writes depth and normals of one view, and the format's other files.
void write_priors(const std::string& out,
                  const TriangleMesh& mesh,
                  const SynthOptions& options,
                  const SynthView& view,
                  int index);

/// Writes the format's files for all views together.
void finish_priors(const std::string& out,
                   const TriangleMesh& mesh,
                   const SynthOptions& options,
                   const std::vector<SynthView>& views);

}  // namespace tvsgs::synth
