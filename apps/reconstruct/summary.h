// The last messages of a reconstruction.
#pragma once

#include <string>

namespace tvsgs::reconstruct {

/// Logs the results of a run folder: numbers, limits of the quality, and places of the files.
/// `scene`: for the number of photographs that were given, if tvsgs-prepare made the scene; else
/// empty.
void log_summary(const std::string& run, const std::string& scene, const std::string& page);

}  // namespace tvsgs::reconstruct
