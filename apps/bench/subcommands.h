// The subcommands of tvsgs-bench. JSON goes to standard output, tables to standard error.
#pragma once

#include "apps/common/command_line.h"

namespace tvsgs {

/// Agreement with the oracle's stored cases, and times on synthetic splats.
Subcommand add_bench_vote(CLI::App& app);

/// Times of the parts of a training iteration on fixed synthetic views.
Subcommand add_bench_stages(CLI::App& app);

}  // namespace tvsgs
