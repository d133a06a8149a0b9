// The report of a run, made anew from its folder.
#pragma once

#include <string>

namespace tvsgs {

/// Writes RUN/report.json and RUN/report.html again; a run that has moved away from its scene does
/// without what it lacks. `scene`: its folder, where that is not what the run says. Throws
/// Error(ExitCode::input) when `run` is no run folder.
void make_report(const std::string& run, const std::string& scene = {});

/// The same for the run that `written`, a file just made, is a result of: RUN/mesh/mesh.ply or
/// RUN/eval/NAME.json, where RUN has a report. A report that cannot be made is a warning. Returns
/// the run; empty: there is no report.
std::string refresh_report(const std::string& written);

}  // namespace tvsgs
