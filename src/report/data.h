// What a report says: report.json, collected from a run folder.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/log.h"
#include "core/scene.h"
#include "io/json_value.h"
#include "pipeline/train_evaluation.h"

namespace tvsgs {

/// A part of a report, or of `whole`, that cannot be made is left out, with a warning.
template <class Action>
void if_possible(const char* part, const Action& action, const char* whole = "report") {
    try {
        action();
    } catch (const Error& error) {
        spdlog::warn("{}; the {} does without {}", error.what(), whole, part);
    }
}

/// Writes RUN/report.json and RUN/report.html. `test`: the views with their photographs, for the
/// pictures beside the renders; may be empty. A run that has not ended has a report, too. Throws
/// Error(ExitCode::input) when `run` is no run folder. `origin`: the scene's, truth's too.
void write_report(const std::string& run,
                  const std::vector<View>& test,
                  const std::optional<Truth>& truth,
                  Vec3d origin);

/// The tree of report.json. Keys: format, run, config, summary, reports (columns), stages,
/// evaluations, views, nvs, curve, mesh_curve, results (RUN/eval/*.json), pictures, points,
/// mesh_points.
JsonValue collect_report(const std::string& run,
                         const std::vector<View>& test,
                         const std::optional<Truth>& truth,
                         Vec3d origin);

}  // namespace tvsgs
