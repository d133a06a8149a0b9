// The subcommands of tvsgs-eval and their common parts.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "apps/common/command_line.h"

namespace tvsgs {

/// A subcommand with its flags in `app`, and the function to run if it is chosen.
struct EvalCommand {
    CLI::App* command;
    std::function<int()> run;  // returns the exit code
};
EvalCommand add_eval_geometry(CLI::App& app);
EvalCommand add_eval_dtu(CLI::App& app);
EvalCommand add_eval_tnt(CLI::App& app);
EvalCommand add_eval_nvs(CLI::App& app);
EvalCommand add_eval_report(CLI::App& app);
EvalCommand add_eval_run(CLI::App& app);
EvalCommand add_eval_table(CLI::App& app);

/// A result that --require can test, by its name there.
struct Metric {
    std::string key;
    double value;
};

/// KEY<=X, KEY>=X, KEY<X or KEY>X.
struct Bound {
    std::string text, key, relation;
    double limit = 0;

    bool holds(double value) const {
        if (relation == "<=") return value <= limit;
        if (relation == ">=") return value >= limit;
        return relation == "<" ? value < limit : value > limit;
    }
};

/// Results of the subcommands that measure distances.
inline const std::vector<std::string> kDistanceKeys = {"accuracy", "completeness", "chamfer",
                                                       "median_accuracy", "median_completeness"};

/// Parses the bounds before anything is measured. `keys`: of the results; "f1@" admits any
/// threshold. Throws Error(ExitCode::usage).
std::vector<Bound> parse_bounds(const std::vector<std::string>& texts,
                                const std::vector<std::string>& keys);

/// Returns the exit code: 0, or that of an unmet bound.
int check_bounds(const std::vector<Bound>& bounds, const std::vector<Metric>& metrics);

/// Throws Error(ExitCode::usage) if a flag was given without the flag that it depends on.
void require_owner(const CLI::App& command,
                   const char* flag,
                   bool has_owner,
                   const std::string& owner);

/// Throws Error(ExitCode::usage) if both flags were given, because one would have no effect.
void refuse_both(const CLI::App& command, const char* flag, const char* other);

/// Adds --require, which all subcommands have.
void add_require(CLI::App& command, std::vector<std::string>& require, const std::string& example);

}  // namespace tvsgs
