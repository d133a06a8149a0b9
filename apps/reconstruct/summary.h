// The last messages of a reconstruction.
#pragma once

#include <string>

namespace tvsgs::reconstruct {

/// Logs the results of a run folder: numbers, limits of the quality, and places of the files.
/// `scene`: of the run; its prepare.json, if there is one, has the number of given photographs.
void log_summary(const std::string& run, const std::string& scene, const std::string& page);

}  // namespace tvsgs::reconstruct
