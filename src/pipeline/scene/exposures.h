// RUN/exposure.json: what a run has fitted of each photograph's exposure, for others to hold.
#pragma once

#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "optim/losses/loss.h"

namespace tvsgs {

/// Whether a run has left any.
bool has_exposures(const std::string& run);

/// `values`: of scene.train.
void write_exposures(const std::string& run, const Scene& scene, const HeldExposures& values);

/// Fills options.held with those of options.exposure_from for the training views, by name. Nothing
/// where that is empty. Throws Error(ExitCode::input) where the run has none, or not of a view.
void read_exposures(PhotometricOptions& options, const std::vector<View>& train);

}  // namespace tvsgs
