// Collects report.json from a run folder, and writes the report, again if needed.
#pragma once

#include <string>
#include <vector>

#include "core/error.h"
#include "core/log.h"
#include "core/scene/scene.h"
#include "io/files/json_value.h"

namespace tvsgs {

/// Runs `action`, which makes `part` of the page `whole`. On an Error, warns that the part is
/// missing, and adds the reason to `missing`.
template <class Action>
void if_possible(const char* part,
                 const Action& action,
                 const char* whole = "report",
                 std::vector<std::string>* missing = nullptr) {
    try {
        action();
    } catch (const Error& error) {
        spdlog::warn("{}; missing from the {}: {}", error.what(), whole, part);
        if (missing != nullptr) missing->push_back(str(part, ": ", error.what()));
    }
}

/// The name of a folder such as "runs/a/" or ".".
std::string folder_name(const std::string& path);

/// Writes RUN/report.json and RUN/report.html from the present state of the run. `scene`: the run's
/// scene, for photographs beside renders and in the 3D view; may have no views. `missing`: gaps to
/// report besides those found here. Throws Error(ExitCode::input) when `run` is no run folder.
///
/// Keys of report.json: format, run, config, plan (its decisions), memory, summary, reports
/// (columns), stages, evaluations, views, nvs, curve, mesh_curve, results (RUN/eval/*.json),
/// pictures, training_views, splats, coverage (report/coverage.h), mesh (faces), missing.
void write_report(const std::string& run,
                  const Scene& scene,
                  std::vector<std::string> missing = {});

/// Writes RUN/report.json and RUN/report.html again. `scene`: the scene's folder if it is not the
/// one that the run names; leaves out parts that need a missing scene. Throws
/// Error(ExitCode::input) when `run` is no run folder.
void make_report(const std::string& run, const std::string& scene = {});

/// Updates the report of the run that contains the new file `written`, RUN/mesh/mesh.ply or
/// RUN/eval/NAME.json; for the mesh, writes the report that a run lacks. Warns if the report fails.
/// Returns the run; empty: it has no report.
std::string refresh_report(const std::string& written);

}  // namespace tvsgs
