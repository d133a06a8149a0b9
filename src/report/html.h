// Makes the HTML page of a report.
#pragma once

#include <optional>
#include <string>

#include "io/files/json_value.h"
#include "report/view_page.h"

namespace tvsgs {

/// The HTML page of a report: one file, made from report.json and from the page of tvsgs-view that
/// it embeds. Leaves out parts that the run lacks.
std::string report_html(const JsonValue& report, const std::optional<ViewPage>& view = {});

}  // namespace tvsgs
