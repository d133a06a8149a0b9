// tvsgs-bench stability: errors of float formulas under stress, as a table and as plots.
#pragma once

#include <string>

#include "apps/common/command_line.h"

namespace tvsgs {

class StabilityBench {
public:
    /// Adds the subcommand; its flags are read into this object.
    explicit StabilityBench(CLI::App& app);

    bool parsed() const { return command_->parsed(); }
    /// Exit code, that of a numerical failure where a row leaves its bound; a table on standard
    /// output.
    int run() const;

private:
    CLI::App* command_;
    std::string device_ = "auto", json_, plot_;
};

}  // namespace tvsgs
