// The subcommands of tvsgs-blocks, and what they share.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "apps/common/command_line.h"
#include "pipeline/blocks/blocks_folder.h"

namespace tvsgs {

/// Adds a subcommand with its flags to `app`; returns it and what runs when it was chosen.
struct BlocksCommand {
    CLI::App* command;
    std::function<int(bool quiet)> run;  // to exit code
};
BlocksCommand add_blocks_split(CLI::App& app);
BlocksCommand add_blocks_run(CLI::App& app);
BlocksCommand add_blocks_slurm(CLI::App& app);
BlocksCommand add_blocks_status(CLI::App& app);
BlocksCommand add_blocks_merge(CLI::App& app);

/// BLOCKS, of which all but `split` are.
inline void add_blocks_folder(CLI::App& command, std::string& folder) {
    command.add_option("folder,-b,--blocks", folder, "folder that tvsgs-blocks split has written")
        ->required();
}

/// Holds a block's folder for this process; another one is refused.
class BlockLock {
public:
    /// Tells by held() whether another process has it.
    explicit BlockLock(const std::string& folder);
    BlockLock(const BlockLock&) = delete;
    BlockLock& operator=(const BlockLock&) = delete;
    ~BlockLock();
    bool held() const { return held_; }

private:
    int lock_ = -1;
    bool held_ = false;
};

/// tvsgs-train, in this process. Throws as it does.
void run_train(const std::vector<std::string>& words);

}  // namespace tvsgs
