// The sky behind a scene, and RUN/sky.png: where it is found, drawn, and kept. [docs/method/sky.md]
#pragma once

#include <string>

#include "optim/photo/sky.h"
#include "pipeline/run/run_options.h"
#include "plan/settings.h"

namespace tvsgs {

inline bool has_sky(const PhotometricOptions& options) {
    return parse_background(options.background).kind == PhotoBackground::Kind::sky;
}

/// Looks for a sky, lets `plan` decide, if there is one and masks or the user have not, and makes
/// the map of it where the run is to have one: of the photographs, or as options.sky_from has it.
/// The points of the scene that lie in it are dropped then. Returns what was seen, nothing where
/// there is no sky. Throws Error(ExitCode::input).
SkyLook provide_sky(RunOptions& options, Scene& scene, RunPlan* plan);

/// Whether a run has left one.
bool has_sky_file(const std::string& run);

/// Where the options have a map.
void write_sky(const std::string& run, const PhotometricOptions& options);

/// The map of the run, where the background is a sky. Throws Error(ExitCode::input) without one.
void read_sky(PhotometricOptions& options, const std::string& run);

}  // namespace tvsgs
