// The subcommands of tvsgs-eval, and what they share.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "apps/common/command_line.h"

namespace tvsgs {

/// Adds a subcommand with its flags to `app`; returns it and what runs when it was chosen.
struct EvalCommand {
    CLI::App* command;
    std::function<int()> run;  // to exit code
};
EvalCommand add_eval_geometry(CLI::App& app);
EvalCommand add_eval_dtu(CLI::App& app);
EvalCommand add_eval_tnt(CLI::App& app);
EvalCommand add_eval_nvs(CLI::App& app);
EvalCommand add_eval_report(CLI::App& app);
EvalCommand add_eval_run(CLI::App& app);
EvalCommand add_eval_table(CLI::App& app);

/// A result that --require can ask for, by the name it has there.
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

/// Throws Error(ExitCode::usage).
std::vector<Bound> parse_bounds(const std::vector<std::string>& texts);

/// Exit code: that of an unmet bound when one of `bounds` does not hold.
int check_bounds(const std::vector<Bound>& bounds, const std::vector<Metric>& metrics);

/// Throws Error(ExitCode::usage) where a flag was given without what it belongs to: it would have
/// no effect.
void require_owner(const CLI::App& command,
                   const char* flag,
                   bool has_owner,
                   const std::string& owner);

/// Throws Error(ExitCode::usage) where both were given, of which one would have no effect.
void refuse_both(const CLI::App& command, const char* flag, const char* other);

/// --require, which all subcommands have.
void add_require(CLI::App& command, std::vector<std::string>& require, const std::string& example);

}  // namespace tvsgs
