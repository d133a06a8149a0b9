// Priors of a made-up scene, as other programs would have written them: exact, or wrong on request.
#pragma once

#include <string>

#include "apps/synth/views.h"
#include "core/scene/mesh.h"

namespace tvsgs::synth {

/// The formats of --priors, for its help and check.
inline const std::vector<std::string> kPriorFormats{"npy",    "vggt", "params",   "colmap",
                                                    "mvsnet", "acmm", "omnidata", "json"};

/// Throws Error(ExitCode::usage) for a quantity where the format has its own.
void check_priors(const SynthPriors& priors);

/// Writes depth and normals of one view, and what else the format has.
void write_priors(const std::string& out,
                  const TriangleMesh& mesh,
                  const SynthOptions& options,
                  const SynthView& view,
                  int index);

/// What the format has for all views.
void finish_priors(const std::string& out,
                   const TriangleMesh& mesh,
                   const SynthOptions& options,
                   const std::vector<SynthView>& views);

}  // namespace tvsgs::synth
