// Trains one block in this process, or all blocks in separate processes.
#pragma once

#include <string>
#include <vector>

#include "pipeline/blocks/blocks_folder.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {

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

}  // namespace tvsgs
