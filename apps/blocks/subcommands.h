// The subcommands of tvsgs-blocks and their common parts.
#pragma once

#include <string>
#include <vector>

#include "apps/common/command_line.h"
#include "pipeline/blocks/blocks_folder.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {

Subcommand add_blocks_split(CLI::App& app);
Subcommand add_blocks_run(CLI::App& app);
Subcommand add_blocks_slurm(CLI::App& app);
Subcommand add_blocks_status(CLI::App& app);
Subcommand add_blocks_merge(CLI::App& app);

/// BLOCKS, the folder that all subcommands but `split` read.
inline void add_blocks_folder(CLI::App& command, std::string& folder) {
    command.add_option("folder,-b,--blocks", folder, "folder written by tvsgs-blocks split")
        ->required();
}

struct RunArguments {
    std::string folder, scene, device = "auto", gpus, progress = "auto";
    int block = 0, jobs = 0;
    int checkpoint_every = 5000;
    bool again = false;
    std::vector<std::string> settings;
};

/// The settings of the whole scene, as resolved by split, with those of the command line.
RunOptions whole_options(const BlocksManifest& manifest,
                         const std::vector<std::string>& settings = {});

/// Throws Error(ExitCode::input) unless `scene` is the one that was split.
void check_scene(const BlocksManifest& manifest, const std::string& scene);

/// Trains the unfinished blocks in parallel, one per GPU or in several processes on the CPU.
/// Returns the exit code of the first block that failed twice, or 0.
int run_all_blocks(const RunArguments& arguments);

/// Runs tvsgs-train in this process. Throws what it throws.
void run_train(const std::vector<std::string>& words);

}  // namespace tvsgs
