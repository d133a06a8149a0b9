// Writes and reads RUN/exposure.json: the fitted exposure of each photograph.
#pragma once

#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "optim/losses/losses_list.h"

namespace tvsgs {

bool has_exposures(const std::string& run);

/// `values`: per view of scene.train.
void write_exposures(const std::string& run, const Scene& scene, const HeldExposures& values);

/// Fills options.held with the exposures of the run options.exposure_from for the training views,
/// by name. Does nothing if exposure_from is empty. Throws Error(ExitCode::input) where the run has
/// no exposures, or lacks a view.
void read_exposures(PhotometricOptions& options, const std::vector<View>& train);

}  // namespace tvsgs
