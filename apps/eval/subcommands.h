// The subcommands of tvsgs-eval and their common parts.
#pragma once

#include <string>
#include <vector>

#include "apps/common/command_line.h"
#include "io/files/json_value.h"

namespace tvsgs {

Subcommand add_eval_geometry(CLI::App& app);
Subcommand add_eval_dtu(CLI::App& app);
Subcommand add_eval_tnt(CLI::App& app);
Subcommand add_eval_nvs(CLI::App& app);
Subcommand add_eval_report(CLI::App& app);
Subcommand add_eval_run(CLI::App& app);
Subcommand add_eval_table(CLI::App& app);

struct MatrixOptions {
    std::string file;
    std::string data;                 // value of "${data}"; empty: none
    std::vector<std::string> scenes;  // only these; empty: all
    bool dry_run = false;             // print the commands without running them
};

/// Runs the experiments of a matrix file, scenes x configurations x seeds
/// (docs/guide/evaluation.md), and returns the runs as CONFIGURATION=DIR. Skips finished runs and
/// resumes interrupted ones; a failed run is reported and left out. Throws Error(ExitCode::input)
/// for an invalid file, and Error(ExitCode::usage) if a finished run was trained with other flags.
std::vector<std::string> run_matrix(const MatrixOptions& options);

/// Prints the report, and writes it to `out` unless that is empty.
void put_report(const JsonValue& json, const std::string& out);

/// The last file that this command has put into a run folder; the run's report is updated at the
/// end.
std::string& result_of_run();

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

/// Returns the exit code: 0, or that of an unmet bound. `results`: the report of a subcommand.
int check_bounds(const std::vector<Bound>& bounds, const JsonValue& results);

/// Throws Error(ExitCode::usage) if a flag was given without the flag that it depends on.
void require_owner(const CLI::App& command,
                   const char* flag,
                   bool has_owner,
                   const std::string& owner);

/// Adds --require, which all subcommands have.
void add_require(CLI::App& command, std::vector<std::string>& require, const std::string& example);

}  // namespace tvsgs
