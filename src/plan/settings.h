// The plan of a run: decisions become settings where nothing else has set them.  docs/guide/plan.md
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/config/config.h"
#include "plan/plan.h"

namespace tvsgs {

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
                     "photographs stop improving");
        field("time_budget", time_budget, {0, 1e9},
              "shorten the schedule to so many seconds of training; 0: no limit");
        field("coverage", coverage, {-1, 1e3},
              "start points per textured pixel, for the decisions of the plan; below 0: measured");
    }
};

class RunPlan {
public:
    explicit RunPlan(OptionTable& table) : table_(table) {}

    /// Takes a decision's settings over, but for keys that the user set; a later decision has the
    /// last word on a key. With `config` its settings are the keys of that configuration, JSON.
    void apply(const Decision& decision, const char* config = nullptr);

    /// What the decisions go by; the last look is shown.
    void note(const SceneLook& look) { look_ = look; }
    /// A last line.
    void remark(const std::string& text) { remark_ = text; }

    /// Switches plan.enabled off: the configuration has the decisions in it, and a run that repeats
    /// it must not make them again.
    void finish() { table_.set("plan.enabled", "false", "the plan"); }

    /// Whether somebody else has set the key, and not to the choice "auto", which leaves it open.
    bool pinned(const std::string& key) const;

    /// A line per decision, for --plan.
    std::string text() const;
    /// RUN/plan.json
    std::string json() const;
    bool empty() const { return lines_.empty(); }

private:
    struct Line {
        Decision decision;  // its settings: those that were taken
        Settings kept;      // what the user set instead: key, "value by source"
    };

    OptionTable& table_;
    std::optional<SceneLook> look_;
    std::vector<Line> lines_;
    std::string remark_;
};

}  // namespace tvsgs
