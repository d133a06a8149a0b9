// Runs the training processes of blocks, several at a time.  [docs/guide/blocks.md]
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "io/files/json_value.h"
#include "pipeline/run/child_process.h"

namespace tvsgs {

struct BlockJob {
    int block = 0;
    std::string log;        // file that receives the messages of its process
    double iterations = 0;  // total number at the end of its training
};

struct BlockProgress {
    int block = 0;
    std::string place;
    double seconds = 0;  // since its process started
    double share = 0;    // finished share of its iterations
    double left = 0;     // remaining seconds; NaN: unknown
};

/// A block whose process failed twice.
struct BlockFailure {
    int block = 0;
    int code = 0;  // exit code, 128 + N after signal N
};

struct BlockSchedule {
    /// Devices, "cuda:0", "cuda:1"; each trains one block at a time.
    std::vector<std::string> places;

    /// The command that trains a block; `alone`: no other process runs. The program writes the
    /// lines of `tvsgs-train --progress json`. May throw Error; the block then counts as failed.
    std::function<ChildProcess::Command(int block, const std::string& place, bool alone)> command;

    /// Receives each progress line.
    std::function<void(int block, const JsonValue& report)> on_report = [](int, const JsonValue&) {
    };

    /// Called several times a second with the running blocks, ordered by place.
    std::function<void(const std::vector<BlockProgress>& running, int done, int waiting)> show =
        [](const std::vector<BlockProgress>&, int, int) {};
};

/// Runs all jobs, each on the first free place. Runs a failed job once more after all others,
/// alone, on another place if possible. A place whose device was not usable (ExitCode::device) gets
/// no further block while other places exist. Returns the blocks that failed twice. Forwards a
/// terminating signal once to all processes, and throws Stopped when they have ended.
std::vector<BlockFailure> run_blocks(const std::vector<BlockJob>& jobs,
                                     const BlockSchedule& schedule);

}  // namespace tvsgs
