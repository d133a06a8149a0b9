// tvsgs-bench vote: agreement with the oracle's stored cases, and times on synthetic splats.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "apps/common/command_line.h"

namespace tvsgs {

class VoteBench {
public:
    /// Adds the subcommand; its flags are read into this object.
    explicit VoteBench(CLI::App& app);

    bool parsed() const { return command_->parsed(); }
    /// Exit code; JSON on standard output, tables on standard error.
    int run() const;
    bool quiet() const { return quiet_; }

private:
    int compare_cases() const;
    int time_synthetic() const;

    CLI::App* command_;
    std::vector<std::string> cases_, configs_, settings_;
    std::string device_ = "auto", shape_ = "sphere", out_;
    int synthetic_ = 0, repetitions_ = 20, warm_up_ = 3;
    std::uint64_t seed_ = 1;
    bool errors_ = false, quiet_ = false;
};

}  // namespace tvsgs
