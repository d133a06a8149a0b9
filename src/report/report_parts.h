// Parts of a report: the overlap of its photographs, its verdict, and its page.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/scene/gaussians.h"
#include "io/files/json_value.h"
#include "report/view_page.h"

namespace tvsgs {

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
    std::string what;                 // views, splats, iterations, seconds, device
    std::string level;                // "good", "fair" or "poor"; empty: not measured
    std::string quality;              // the measurements, and the thresholds of the levels
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
