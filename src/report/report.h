// Reports of runs: report.json from a run folder, and its page. Parts of a report: the overlap of
// its photographs, and its verdict.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/error.h"
#include "core/log.h"
#include "core/scene/scene.h"
#include "io/files/json_value.h"
#include "report/view_page.h"

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
/// pictures, training_views, splats, coverage (coverage_json()), mesh (faces), missing.
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

inline constexpr std::size_t kMaxCoverageViews = 400;  // the time grows with their square

/// Measures the overlap of a run's photographs from its splats: which views share surface, and
/// which surface a single view shows. Uses the centres of opaque splats in a coarse depth buffer of
/// each view. Returns
///   {"two": share of the surface in training views that at least two of them see,
///    "views": [{"name", "lone": share of the view that no other view sees,
///               "side": half of the view with most of that, "left", ..., or empty,
///               "partner": view that shares most with it, "shared"}],
///    "gap": {"a", "b", "angle_deg", "shared"}: the weakest link of the tree that joins all views
///           by the smallest angles between rays to shared points,
///    "test": [{"name", "nearest": training view with the smallest angle to the test view, measured
///              at the mean of the points that the test view sees, "angle_deg"}]}
/// Returns null where no training view sees a splat, and for more than kMaxCoverageViews training
/// views.
JsonValue coverage_json(const Gaussians<Cpu>& splats, const std::vector<ViewCamera>& cameras);

/// The first lines of a report: results, their quality, its limits, and which photographs to take
/// next. Each sentence gives the number that it is based on.
struct RunVerdict {
    std::string what;     // views, splats, iterations, seconds, device; size and detail of the mesh
    std::string level;    // "good", "fair" or "poor"; empty: not measured
    std::string quality;  // the measurements, and the thresholds of the levels
    std::vector<std::string> limits;  // measured reasons that limit the quality; may be empty
    std::vector<std::string> next;    // photographs to take
    std::string left_out;             // steps that the plan left out; empty: no plan
};

/// Reads the tree of report.json; all parts of it are optional.
RunVerdict verdict_of(const JsonValue& report);

/// The HTML page of a report: one file, made from report.json and from the page of tvsgs-view that
/// it embeds. Leaves out parts that the run lacks.
std::string report_html(const JsonValue& report, const std::optional<ViewPage>& view = {});

}  // namespace tvsgs
