#include "apps/eval/subcommands.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>

#include "io/files/atomic_file.h"

namespace tvsgs {
namespace {

Bound parse_bound(const std::string& text) {
    Bound bound{text, "", "", 0};
    const std::size_t at = text.find_first_of("<>");
    if (at != std::string::npos && at > 0) {
        const std::size_t length = at + 1 < text.size() && text[at + 1] == '=' ? 2 : 1;
        bound.key = text.substr(0, at);
        bound.relation = text.substr(at, length);
        bound.key.erase(bound.key.find_last_not_of(' ') + 1);
        const std::size_t number = text.find_first_not_of(' ', at + length);
        if (number != std::string::npos) {
            const auto [rest, code] =
                std::from_chars(text.data() + number, text.data() + text.size(), bound.limit);
            if (code == std::errc{} && rest == text.data() + text.size() &&
                !std::isnan(bound.limit))
                return bound;
        }
    }
    throw usage_error("--require ", text,
                      ": expected KEY<=X or KEY>=X, for example chamfer<=2 or f1@1>=0.4");
}

/// Compares thresholds in keys such as f1@1 as numbers: f1@1.0 is the same key.
bool same_key(const std::string& a, const std::string& b) {
    const auto split = [](const std::string& key) {
        const std::size_t at = key.find('@');
        double tau = std::nan("");
        if (at != std::string::npos)
            std::from_chars(key.data() + at + 1, key.data() + key.size(), tau);
        return std::pair{key.substr(0, at), tau};
    };
    const auto [name_a, tau_a] = split(a);
    const auto [name_b, tau_b] = split(b);
    return a == b || (name_a == name_b && tau_a == tau_b);
}

[[noreturn]] void refuse_key(const Bound& bound, const std::vector<std::string>& keys) {
    std::string known;
    for (const std::string& key : keys)
        known += str(known.empty() ? "" : ", ", key, key.ends_with('@') ? "TAU" : "");
    throw usage_error("--require ", bound.text, ": no result is called '", bound.key,
                      "'; expected one of ", known);
}

}  // namespace

std::vector<Bound> parse_bounds(const std::vector<std::string>& texts,
                                const std::vector<std::string>& keys) {
    std::vector<Bound> bounds;
    for (const std::string& text : texts) {
        const Bound bound = parse_bound(text);
        const std::string name = bound.key.substr(0, bound.key.find('@') + 1);  // "f1@"; or empty
        if (std::none_of(keys.begin(), keys.end(), [&](const std::string& key) {
                return key.ends_with('@') ? key == name : same_key(key, bound.key);
            }))
            refuse_key(bound, keys);
        bounds.push_back(bound);
    }
    return bounds;
}

int check_bounds(const std::vector<Bound>& bounds, const std::vector<Metric>& metrics) {
    bool met = true;
    for (const Bound& bound : bounds) {
        const auto metric = std::find_if(metrics.begin(), metrics.end(), [&](const Metric& m) {
            return same_key(m.key, bound.key);
        });
        if (metric == metrics.end()) {
            std::vector<std::string> keys;
            for (const Metric& m : metrics) keys.push_back(m.key);
            refuse_key(bound, keys);
        }
        if (bound.holds(metric->value)) continue;
        spdlog::error("Not met: {}; {} is {:.6g}", bound.text, bound.key, metric->value);
        met = false;
    }
    return static_cast<int>(met ? ExitCode::done : ExitCode::bound);
}

void require_owner(const CLI::App& command,
                   const char* flag,
                   bool has_owner,
                   const std::string& owner) {
    const CLI::Option* option = command.get_option(flag);
    if (has_owner || option->count() == 0) return;
    throw usage_error(flag, " ", option->results().back(), ": needs ", owner);
}

void add_require(CLI::App& command, std::vector<std::string>& require, const std::string& example) {
    add_repeated(command, "--require", require,
                 "bound KEY<=X or KEY>=X, such as " + example + "; not met: exit code 8");
}

void put_report(const JsonValue& json, const std::string& out) {
    JsonValue report = JsonValue().add("version", kVersion);
    report.members.insert(report.members.end(), json.members.begin(), json.members.end());
    const std::string text = json_text(report) + "\n";
    std::fputs(text.c_str(), stdout);
    if (out.empty()) return;
    write_text_file(out, text);
    result_of_run() = out;
}

std::string& result_of_run() {
    static std::string path;
    return path;
}

}  // namespace tvsgs
