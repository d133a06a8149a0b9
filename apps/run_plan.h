// The plan of a run: decisions become settings where nothing else has set them.  docs/plan.md
#pragma once

#include <string>
#include <vector>

#include "io/config.h"
#include "optim/plan.h"

namespace tvsgs {

enum class Until { iterations, converged };

struct PlanOptions {
    bool enabled = false;
    Until until = Until::iterations;
    float time_budget = 0;

    template <class Visitor>
    void fields(Visitor& field) {
        field("enabled", enabled, "look at the scene and set what nothing else sets");
        field.choice("until", until, {"iterations", "converged"},
                     "converged: stop when PSNR on views that do not train has stopped rising");
        field("time_budget", time_budget, {0, 1e9},
              "seconds of training that the schedule is fitted into; 0: as long as it takes");
    }
};

class RunPlan {
public:
    explicit RunPlan(OptionTable& table) : table_(table) {}

    /// What the decisions to come go by.
    void note(const SceneLook& look) { looks_.push_back(look); }
    const SceneLook& looked() const { return looks_.back(); }

    /// Takes a decision's settings over, but for keys that the user set. With `config` these are
    /// the keys of a configuration, its JSON.
    void apply(const Decision& decision, const char* config = nullptr);
    void apply(const std::vector<Decision>& decisions);

    /// What was decided is in the configuration now, which is not to be planned again.
    void finish() { table_.set("plan.enabled", "false", "the plan"); }

    /// Whether somebody else has set the key.
    bool pinned(const std::string& key) const;

    /// A line per decision, for --plan.
    std::string text() const;
    /// RUN/plan.json
    std::string json() const;
    bool empty() const { return lines_.empty(); }

private:
    struct Line {
        Decision decision;
        std::string pinned;  // who set the keys instead; empty: the plan
    };

    OptionTable& table_;
    std::vector<SceneLook> looks_;
    std::vector<Line> lines_;
};

}  // namespace tvsgs
