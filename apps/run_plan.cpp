#include "run_plan.h"

#include <algorithm>

#include "core/error.h"

namespace tvsgs {
namespace {

constexpr const char* kSource = "the plan";

}  // namespace

void RunPlan::apply(const Decision& decision, const char* config) {
    Line line{decision, {}};
    if (config != nullptr) table_.read_text_below(kSource, config);
    for (const auto& [key, value] : decision.settings) {
        if (!pinned(key))
            table_.set(key, value, kSource);
        else
            line.pinned =
                str(key, " = ", table_.option(key).get(), " by ", table_.option(key).source);
    }
    lines_.push_back(std::move(line));
}

bool RunPlan::pinned(const std::string& key) const {
    const std::string& source = table_.option(key).source;
    return !source.empty() && source != kSource;
}

void RunPlan::apply(const std::vector<Decision>& decisions) {
    for (const Decision& decision : decisions) apply(decision);
}

std::string RunPlan::text() const {
    std::size_t name = 0, choice = 0;
    for (const Line& line : lines_) {
        name = std::max(name, line.decision.name.size());
        choice = std::max(choice, line.decision.choice.size());
    }
    const auto padded = [](std::string word, std::size_t width) {
        word.resize(std::max(width, word.size()), ' ');
        return word + "  ";
    };
    std::string out;
    if (!looks_.empty())
        out = padded("views", name) + padded("", choice) + summary(looks_.back()) + "\n";
    for (const Line& line : lines_) {
        const Decision& d = line.decision;
        std::string keys;
        for (const auto& [key, value] : d.settings) keys += (keys.empty() ? "" : ", ") + key;
        // A long list is the schedule's.
        if (d.settings.size() > 3) keys = str(d.settings[0].first, ", ...");
        out += padded(d.name, name) + padded(d.choice, choice) + d.reason;
        if (!line.pinned.empty())
            out += str("  [not taken: ", line.pinned, "]");
        else if (!keys.empty())
            out += str("  (", keys, ")");
        out += "\n";
    }
    return out;
}

std::string RunPlan::json() const {
    std::string list;
    for (const Line& line : lines_) {
        const Decision& d = line.decision;
        JsonLine settings, entry;
        for (const auto& [key, value] : d.settings) settings.add(key, value);
        entry.add("name", d.name).add("choice", d.choice).add("reason", d.reason);
        entry.add("measured", d.measured).add("threshold", d.threshold).add("source", d.source);
        entry.add_json("settings", settings.text()).add("pinned", line.pinned);
        list += str(list.empty() ? "" : ",\n  ", entry.text());
    }
    return str("{\"decisions\": [\n  ", list, "\n]}\n");
}

}  // namespace tvsgs
