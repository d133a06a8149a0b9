// Decisions of the plan: plain data, and RunPlan, which applies them to the keys that the user has
// not set and keeps them.  docs/guide/plan.md
#pragma once

#include <limits>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "io/config/config.h"
#include "plan/look.h"

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

enum class Until { iterations, converged };

struct PlanOptions {
    bool enabled = false;
    Until until = Until::iterations;
    float time_budget = 0;
    float coverage = -1;

    template <class Visitor>
    void fields(Visitor& field) {
        field("enabled", enabled, "choose settings from the scene for keys that you do not set");
        field.choice("until", until, {"iterations", "converged"},
                     "end of the training; iterations: all iterations; converged: stop when test "
                     "photographs stop improving or, without any, when the surface stands still");
        field("time_budget", time_budget, {0, 1e9},
              "shorten the schedule to so many seconds of training; 0: no limit");
        field("coverage", coverage, {-1, 1e3},
              "start points per textured pixel, for the decisions of the plan; below 0: measured");
    }
};

/// The source of settings that the plan has made.
inline constexpr const char* kPlanSource = "the plan";

/// Whether the user or a configuration has set the key. The choice "auto" leaves it to the plan.
bool is_pinned(const OptionTable& table, const std::string& key);

/// The parts of a decision's reason that are not in `stated`; adds them to it.
std::string unstated_parts(const std::string& reason, std::set<std::string>& stated);

class RunPlan {
public:
    /// Sets the decision's keys, except pinned ones. The later of two decisions on a key counts.
    void apply(const Decision& decision, OptionTable& table);
    void apply(const std::vector<Decision>& decisions, OptionTable& table) {
        for (const Decision& decision : decisions) apply(decision, table);
    }

    /// Keeps the look for text(); a later look replaces it.
    void note(const SceneLook& look) { look_ = look; }
    /// Adds a last line.
    void remark(const std::string& text) { remark_ = text; }

    /// A line per decision, for --plan. A reason that several decisions share is stated once.
    std::string text() const;
    /// "few photographs; masks used; no new splats; cameras kept".
    std::string brief() const;
    /// RUN/plan.json
    std::string json() const;
    bool empty() const { return lines_.empty(); }

private:
    struct Line {
        Decision decision;  // its settings: only those that were taken
        Settings kept;      // keys that stay as the user set them: "value by source"
    };

    std::optional<SceneLook> look_;
    std::vector<Line> lines_;
    std::string remark_;
};

}  // namespace tvsgs
