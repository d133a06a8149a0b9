// A decision of the plan: plain data, which RunPlan applies.  docs/guide/plan.md
#pragma once

#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace tvsgs {

/// Keys with their new values, as text.
using Settings = std::vector<std::pair<std::string, std::string>>;

/// `measured` or `threshold` of a decision that measured nothing.
inline constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

struct Decision {
    std::string name, choice;
    std::string reason;  // measured value and threshold; parts are separated by "; "
    double measured = 0, threshold = 0;
    Settings settings;    // of the choice
    std::string brief{};  // the choice in the one line of the plan; empty: left out
};

}  // namespace tvsgs
