// The sky behind a scene: finds it, makes its map, and keeps it in RUN/sky.png.
// [docs/method/sky.md]
#pragma once

#include <string>

#include "optim/photo/sky.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {

inline bool has_sky(const PhotometricOptions& options) {
    return parse_background(options.background).kind == PhotoBackground::Kind::sky;
}

/// Whether the background is the blurred photographs.
inline bool is_soft(const PhotometricOptions& options) {
    return options.background == kSoftBackground;
}

/// Looks for a sky and lets `plan` decide on it, if there is a plan and neither the user nor object
/// masks exclude a sky. If the run has one, fills PhotometricOptions::sky with its map, made of the
/// photographs or read from `sky_from`, drops the scene's points in it, and returns the look; else
/// an empty look. Throws Error(ExitCode::input).
SkyDetection provide_sky(Configuration& config, Scene& scene, RunPlan* plan);

/// Fills PhotometricOptions::sky of a soft background, from the photographs or `sky_from`. Throws
/// Error(ExitCode::input).
void provide_soft_background(PhotometricOptions& options, const std::vector<View>& views);

bool has_sky_file(const std::string& run);

/// Writes RUN/sky.png if the options have a map.
void write_sky(const std::string& run, const PhotometricOptions& options);

/// Reads the run's map if the background has one. Throws Error(ExitCode::input) if there is none.
void read_sky(PhotometricOptions& options, const std::string& run);

}  // namespace tvsgs
