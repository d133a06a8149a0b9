// Writes the first lines of a report: results, their quality, its limits, and which photographs to
// take next. Each sentence gives the number that it is based on.
#pragma once

#include <string>
#include <vector>

#include "io/files/json_value.h"

namespace tvsgs {

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

}  // namespace tvsgs
