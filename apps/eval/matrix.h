// Runs the experiments of a table: scenes x configurations x seeds, trained, meshed and measured.
#pragma once

#include <string>
#include <vector>

namespace tvsgs {

struct MatrixOptions {
    std::string file;
    std::string data;                 // value of "${data}"; empty: none
    std::vector<std::string> scenes;  // only these; empty: all
    bool dry_run = false;             // print the commands without running them
    bool quiet = false;               // the commands only print warnings and errors
};

/// Runs the experiments of a matrix file (docs/guide/evaluation.md) and returns the runs as
/// CONFIGURATION=DIR. Skips finished runs and resumes interrupted ones; a failed run is reported
/// and left out. Throws Error(ExitCode::input) for an invalid file, and Error(ExitCode::usage) if a
/// finished run was trained with other flags.
std::vector<std::string> run_matrix(const MatrixOptions& options);

}  // namespace tvsgs
