// Collects report.json from a run folder, and writes the report.
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

}  // namespace tvsgs
