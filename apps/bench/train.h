// tvsgs-bench train: real training, its stages and the seconds to a given quality.
#pragma once

#include <string>
#include <vector>

#include "apps/common/command_line.h"
#include "apps/common/key_flags.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {

class TrainBench {
public:
    /// Adds the subcommand; its flags are read into this object.
    explicit TrainBench(CLI::App& app);

    bool parsed() const { return command_->parsed(); }
    /// Exit code; one line of JSON on standard output, a table on standard error.
    int run();
    bool quiet() const { return quiet_; }

private:
    CLI::App* command_;
    RunOptions options_;
    OptionTable table_;  // of options_
    KeyFlags flags_;
    std::vector<std::string> configs_, settings_;
    std::vector<double> psnr_;
    std::string device_ = "auto", out_;
    int psnr_every_ = 0;
    bool quiet_ = false;
};

}  // namespace tvsgs
