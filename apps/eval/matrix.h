// The runs of a table: scenes x configurations x seeds, trained, meshed and measured.
#pragma once

#include <string>
#include <vector>

namespace tvsgs {

struct MatrixOptions {
    std::string file;
    std::string data;                 // what "${data}" stands for; empty: nothing
    std::vector<std::string> scenes;  // only these; empty: all
    bool dry_run = false;             // print the commands instead
    bool quiet = false;               // the commands say no more than warnings and errors
};

/// Carries out what a matrix file asks for (docs/guide/evaluation.md) and returns its runs as
/// CONFIGURATION=DIR. Finished runs are left as they are, interrupted ones resumed; one that fails
/// is reported and left out. Throws Error(ExitCode::input) for a file that is no matrix, and
/// Error(ExitCode::usage) when a finished run was trained with other flags.
std::vector<std::string> run_matrix(const MatrixOptions& options);

}  // namespace tvsgs
