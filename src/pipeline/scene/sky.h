// Detects the sky of a scene, and writes and reads its map RUN/sky.png. [docs/method/sky.md]
#pragma once

#include <string>

#include "optim/photo/sky.h"
#include "pipeline/run/run_options.h"
#include "plan/settings.h"

namespace tvsgs {

inline bool has_sky(const PhotometricOptions& options) {
    return parse_background(options.background).kind == PhotoBackground::Kind::sky;
}

/// Detects a sky and makes its map where the run uses one, from the photographs or from
/// options.sky_from. `plan` (may be null) decides, unless masks or the user have decided. Removes
/// points of the scene in the sky. Returns the detected pixels; empty without a sky. Throws
/// Error(ExitCode::input).
SkyLook provide_sky(RunOptions& options, Scene& scene, RunPlan* plan);

/// Whether a run has a sky map.
bool has_sky_file(const std::string& run);

/// Writes the map if the options have one.
void write_sky(const std::string& run, const PhotometricOptions& options);

/// Reads the run's map if the background is a sky. Throws Error(ExitCode::input) if it is missing.
void read_sky(PhotometricOptions& options, const std::string& run);

}  // namespace tvsgs
