#pragma once

#include <optional>
#include <string>

#include "io/files/json_value.h"
#include "report/view_page.h"

namespace tvsgs {

/// The page of a report: one file, a function of report.json and of the page of tvsgs-view that it
/// holds. Parts that a run does not have are left out.
std::string report_html(const JsonValue& report, const std::optional<ViewPage>& view = {});

}  // namespace tvsgs
