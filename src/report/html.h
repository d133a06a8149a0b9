#pragma once

#include <string>

#include "io/json_value.h"

namespace tvsgs {

/// The page of a report: one file, a function of report.json alone. Parts that a run does not have
/// are left out.
std::string report_html(const JsonValue& report);

}  // namespace tvsgs
