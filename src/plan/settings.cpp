#include "plan/settings.h"

#include <algorithm>

#include "core/error.h"
#include "core/grouped.h"

namespace tvsgs {
namespace {

/// "key, key, ...", at most three keys.
std::string keys_of(const Settings& settings) {
    std::string keys;
    for (std::size_t i = 0; i < std::min<std::size_t>(settings.size(), 3); ++i)
        keys += str(keys.empty() ? "" : ", ", settings[i].first);
    return settings.size() > 3 ? keys + ", ..." : keys;
}

}  // namespace

std::string unstated_parts(const std::string& reason, std::set<std::string>& stated) {
    std::string left;
    for (std::size_t begin = 0; begin <= reason.size();) {
        const std::size_t end = std::min(reason.find("; ", begin), reason.size());
        const std::string part = reason.substr(begin, end - begin);
        if (stated.insert(part).second) left += str(left.empty() ? "" : "; ", part);
        begin = end + 2;
    }
    return left;
}

bool is_pinned(const OptionTable& table, const std::string& key) {
    const Option& option = table.option(key);
    const bool left_open = option.kind == Option::Kind::choice && option.get() == "auto";
    return !option.source.empty() && option.source != kPlanSource && !left_open;
}

void RunPlan::apply(const Decision& decision, OptionTable& table) {
    Line line{decision, {}};
    line.decision.settings.clear();
    for (const auto& [key, value] : decision.settings) {
        if (is_pinned(table, key)) {
            const Option& option = table.option(key);
            line.kept.emplace_back(key, str(option.get(), " by ", option.source));
            continue;
        }
        table.set(key, value, kPlanSource);
        for (Line& earlier : lines_)
            std::erase_if(earlier.decision.settings,
                          [&, &k = key](const auto& setting) { return setting.first == k; });
        line.decision.settings.emplace_back(key, value);
    }
    lines_.push_back(std::move(line));
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
    std::set<std::string> stated;
    if (look_) {
        const std::string coverage = coverage_text(look_->points_per_pixel);
        out = str(padded("scene", name), look_->train_views, " training and ", look_->test_views,
                  " test photographs; ", grouped(look_->points), " start points\n",
                  padded("coverage", name), coverage, " (the reason of lines without one)\n");
        stated.insert(coverage);
    }
    for (const Line& line : lines_) {
        const Decision& d = line.decision;
        out += padded(d.name, name) + padded(d.choice, choice) + unstated_parts(d.reason, stated);
        if (!d.settings.empty()) out += str("  (", keys_of(d.settings), ")");
        for (const auto& [key, kept] : line.kept) out += str("  [", key, " stays ", kept, "]");
        out += "\n";
    }
    return remark_.empty() ? out : out + remark_ + "\n";
}

std::string RunPlan::brief() const {
    std::string out;
    for (const Line& line : lines_)
        if (const Decision& d = line.decision;
            !d.brief.empty() && (line.kept.empty() || !d.settings.empty()))
            out += str(out.empty() ? "" : "; ", d.brief);
    return out;
}

std::string RunPlan::json() const {
    const auto object = [](const Settings& settings) {
        JsonValue json = JsonValue::object();
        for (const auto& [key, value] : settings) json.add(key, value);
        return json;
    };
    std::string list;
    for (const Line& line : lines_) {
        const Decision& d = line.decision;
        JsonValue entry;
        entry.add("name", d.name).add("choice", d.choice).add("reason", d.reason);
        entry.add("measured", d.measured).add("threshold", d.threshold);
        entry.add("source", str("docs/guide/plan.md, ", d.name));
        entry.add("settings", object(d.settings)).add("kept", object(line.kept));
        list += str(list.empty() ? "" : ",\n  ", json_text(entry));
    }
    return str("{\"decisions\": [\n  ", list, "\n]}\n");
}

}  // namespace tvsgs
