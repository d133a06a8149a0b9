// Output of results.
#pragma once

#include <string>

#include "io/files/json_value.h"

namespace tvsgs {

/// Prints the report, and writes it to `out` unless that is empty.
void put_report(const JsonValue& json, const std::string& out);

/// The last file that this command has put into a run folder; the run's report is updated at the
/// end.
std::string& result_of_run();

}  // namespace tvsgs
