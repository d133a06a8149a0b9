// What a report says: report.json, collected from a run folder.
#pragma once

#include <string>
#include <vector>

#include "core/error.h"
#include "core/log.h"
#include "core/scene/scene.h"
#include "io/files/json_value.h"

namespace tvsgs {

/// A part of a report, or of `whole`, that cannot be made is left out, with a warning that
/// `missing` gets as well.
template <class Action>
void if_possible(const char* part,
                 const Action& action,
                 const char* whole = "report",
                 std::vector<std::string>* missing = nullptr) {
    try {
        action();
    } catch (const Error& error) {
        spdlog::warn("{}; the {} does without {}", error.what(), whole, part);
        if (missing != nullptr) missing->push_back(str(part, ": ", error.what()));
    }
}

/// Writes RUN/report.json and RUN/report.html, with what has become of the run so far. `scene`: the
/// run's, for the photographs beside the renders and in the view in 3D; may have no views. Throws
/// Error(ExitCode::input) when `run` is no run folder. `missing`: what the report says that it
/// lacks beside what is found to be missing here.
///
/// Keys of report.json: format, run, config, plan (its decisions), memory, summary, reports
/// (columns), stages, evaluations, views, nvs, curve, mesh_curve, results (RUN/eval/*.json),
/// pictures, training_views, splats, coverage
/// (report/coverage.h), mesh (faces), missing.
void write_report(const std::string& run,
                  const Scene& scene,
                  std::vector<std::string> missing = {});

}  // namespace tvsgs
