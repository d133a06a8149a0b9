// Which block's process runs where and when.  [docs/guide/blocks.md]
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "io/files/json_value.h"
#include "pipeline/run/child_process.h"

namespace tvsgs {

struct BlockJob {
    int block = 0;
    std::string log;        // file to which the messages of its process are added
    double iterations = 0;  // at the end of its training
};

/// A block in training.
struct BlockProgress {
    int block = 0;
    std::string place;
    double seconds = 0;  // since its process started
    double share = 0;    // of its iterations
    double left = 0;     // seconds; NaN: not known
};

/// A block whose process failed twice.
struct BlockFailure {
    int block = 0;
    int code = 0;  // exit code, 128 + N after signal N
};

struct BlockSchedule {
    /// "cuda:0", "cuda:1": each trains one block at a time.
    std::vector<std::string> places;

    /// The program that trains a block; `alone`: no other one runs beside it. It writes the lines
    /// of `tvsgs-train --progress json`. May throw Error; the block counts as failed then.
    std::function<ChildProcess::Command(int block, const std::string& place, bool alone)> command;

    /// Receives each line of progress.
    std::function<void(int block, const JsonValue& report)> on_report = [](int, const JsonValue&) {
    };

    /// Called several times a second with the blocks in training, in the order of their places.
    std::function<void(const std::vector<BlockProgress>& running, int done, int waiting)> show =
        [](const std::vector<BlockProgress>&, int, int) {};
};

/// Runs all jobs, each on the first place that is free. A failed one runs once more, alone, after
/// all others, on another place where there is one. A place whose device was not usable
/// (ExitCode::device) receives no further block while there is another place. Returns the blocks
/// that failed twice. Sends a signal that ends a command on to all processes, once, and throws
/// Stopped when they have ended.
std::vector<BlockFailure> run_blocks(const std::vector<BlockJob>& jobs,
                                     const BlockSchedule& schedule);

}  // namespace tvsgs
