// tvsgs-eval: measures results. Writes JSON to standard output, messages to standard error.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <memory>
#include <ranges>

#include "apps/eval/subcommands.h"
#include "io/files/atomic_file.h"
#include "io/files/read_file.h"
#include "report/report.h"

namespace tvsgs {
namespace {

/// Logs the written file and how to view it.
void say_result(const std::string& file) {
    spdlog::info("Scores: {}", file);
    if (const std::string run = refresh_report(file); !run.empty())
        say_next({"tvsgs-view", run}, "look at it in a browser");
}

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

[[noreturn]] void refuse_key(const Bound& bound, std::vector<std::string> keys) {
    for (std::string& key : keys)
        if (key.ends_with('@')) key += "TAU";
    throw usage_error("--require ", bound.text, ": no result is called '", bound.key,
                      "'; expected one of ", joined(keys));
}

/// The results that --require can test, by their names there: numbers of `results`, and of its list
/// "thresholds" as KEY@TAU. NaN: null.
std::vector<std::pair<std::string, double>> testable(const JsonValue& results) {
    std::vector<std::pair<std::string, double>> found;
    const auto add = [&](const JsonValue& from, const std::string& end) {
        for (const auto& [key, value] : from.members)
            if ((value.is(JsonValue::Kind::number) || !value) && key != "tau" &&
                !key.ends_with("_se"))
                found.emplace_back(key + end, value.number_or(std::nan("")));
    };
    add(results, "");
    for (const JsonValue& t : results["thresholds"].items) add(t, str("@", t["tau"].number));
    return found;
}

}  // namespace

std::vector<Bound> parse_bounds(const std::vector<std::string>& texts,
                                const std::vector<std::string>& keys) {
    std::vector<Bound> bounds;
    for (const std::string& text : texts) {
        const Bound bound = parse_bound(text);
        const std::string name = bound.key.substr(0, bound.key.find('@') + 1);  // "f1@"; or empty
        if (std::ranges::none_of(keys, [&](const std::string& key) {
                return key.ends_with('@') ? key == name : same_key(key, bound.key);
            }))
            refuse_key(bound, keys);
        bounds.push_back(bound);
    }
    return bounds;
}

int check_bounds(const std::vector<Bound>& bounds, const JsonValue& results) {
    const auto found = testable(results);
    bool met = true;
    for (const Bound& bound : bounds) {
        const auto result = std::ranges::find_if(
            found, [&](const auto& one) { return same_key(one.first, bound.key); });
        if (result == found.end()) {
            const auto keys = std::views::keys(found);
            refuse_key(bound, {keys.begin(), keys.end()});
        }
        if (bound.holds(result->second)) continue;
        spdlog::error("Not met: {}; {} is {:.6g}", bound.text, bound.key, result->second);
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

Subcommand add_eval_report(CLI::App& app) {
    const auto run = std::make_shared<std::string>(), scene = std::make_shared<std::string>();
    CLI::App* command =
        app.add_subcommand("report", "write report.json and report.html of a run folder again");
    command->add_option("--run,-m,--model,--model-path", *run, "run folder")->required();
    command->add_option("-s,--scene", *scene, "folder of the scene [that of the run]");
    return {command, [run, scene] {
                make_report(*run, *scene);
                say_next({"tvsgs-view", *run}, "look at it in a browser");
                return 0;
            }};
}

int command(int argc, char** argv) {
    CLI::App app{"Measures meshes, splats and renders against the truth.", "tvsgs-eval"};
    app.footer(
        "Example, all that applies to a run and its true surface:\n"
        "  tvsgs-eval run --model RUN --gt SURFACE.ply");
    const int code = run_subcommand(
        app,
        {add_eval_geometry(app), add_eval_dtu(app), add_eval_tnt(app), add_eval_nvs(app),
         add_eval_run(app), add_eval_report(app), add_eval_table(app)},
        Verbosity::verbose, argc, argv);
    if (!result_of_run().empty()) say_result(result_of_run());
    return code;
}

}  // namespace tvsgs
