// The subcommands of tvsgs-blocks and their common parts.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "apps/common/command_line.h"
#include "pipeline/blocks/blocks_folder.h"
#include "pipeline/run/run_folder.h"

namespace tvsgs {

/// A subcommand with its flags in `app`, and the function to run if it is chosen.
struct BlocksCommand {
    CLI::App* command;
    std::function<int(bool quiet)> run;  // returns the exit code
};
BlocksCommand add_blocks_split(CLI::App& app);
BlocksCommand add_blocks_run(CLI::App& app);
BlocksCommand add_blocks_slurm(CLI::App& app);
BlocksCommand add_blocks_status(CLI::App& app);
BlocksCommand add_blocks_merge(CLI::App& app);

/// BLOCKS, the folder that all subcommands but `split` read.
inline void add_blocks_folder(CLI::App& command, std::string& folder) {
    command.add_option("folder,-b,--blocks", folder, "folder written by tvsgs-blocks split")
        ->required();
}

/// Runs tvsgs-train in this process. Throws what it throws.
void run_train(const std::vector<std::string>& words);

}  // namespace tvsgs
