// What a report says first: what became of the photographs, how good it is, why it is no better,
// and what to photograph next. Each sentence has the number it rests on.
#pragma once

#include <string>
#include <vector>

#include "io/files/json_value.h"

namespace tvsgs {

struct RunVerdict {
    std::string what;                 // views, splats, iterations, seconds, device
    std::string level;                // "good", "fair" or "poor"; empty: not measured
    std::string quality;              // the measurements, and where the levels begin
    std::vector<std::string> limits;  // by what was measured; empty: nothing that was measured
    std::vector<std::string> next;    // photographs to take
    std::string left_out;             // by the plan; empty: there was none
};

/// Of the tree of report.json, whatever it lacks.
RunVerdict verdict_of(const JsonValue& report);

}  // namespace tvsgs
