// The command line of tvsgs-train.
#pragma once

#include <string>

#include "pipeline/run/resume.h"
#include "pipeline/run/run_options.h"
#include "pipeline/run/train_session.h"

namespace tvsgs {

struct TrainArguments {
    Configuration asked;  // defaults < configuration files < environment < command line
    std::string out;      // run folder; not empty
    std::string device = "auto";
    bool overwrite = false, plan = false, list_keys = false, report = true;
    SessionOptions session;
    Resume resume;
    std::string command_line;
};

/// Reads the command line, the configurations and the checkpoint of --resume; starts the log.
/// Throws Error(ExitCode::usage).
TrainArguments parse_train_arguments(int argc, char* const* argv);

/// Throws Error(ExitCode::usage) for arguments that cannot work, before the scene is read, which
/// takes a while.
void check_train_arguments(const TrainArguments& arguments);

}  // namespace tvsgs
