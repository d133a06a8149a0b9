// Makes the report of a run again from its folder.
#pragma once

#include <string>

namespace tvsgs {

/// Writes RUN/report.json and RUN/report.html again. `scene`: the scene's folder if it is not the
/// one that the run names; leaves out parts that need a missing scene. Throws
/// Error(ExitCode::input) when `run` is no run folder.
void make_report(const std::string& run, const std::string& scene = {});

/// Updates the report of the run that contains the new file `written`, RUN/mesh/mesh.ply or
/// RUN/eval/NAME.json; for the mesh, writes the report that a run lacks. Warns if the report fails.
/// Returns the run; empty: it has no report.
std::string refresh_report(const std::string& written);

}  // namespace tvsgs
