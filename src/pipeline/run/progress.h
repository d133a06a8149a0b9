// Shows the progress of a training on a terminal, in a log, or as JSON for a program.
#pragma once

#include <string>
#include <vector>

#include "core/progress.h"
#include "io/files/json_value.h"
#include "optim/loop/train.h"

namespace tvsgs {

class TrainProgress {
public:
    /// `seconds`: training time before the run was resumed.
    explicit TrainProgress(const TrainOptions& options, double seconds = 0);

    void set_schedule(const TrainOptions& options);

    /// Training time without pauses, in seconds.
    double seconds() const;

    /// Stops the clock until resume().
    void pause();
    void resume();

    /// The line for log.jsonl.
    JsonValue json(const TrainReport& report) const;

    /// Prints as progress_style() requires; as JSON: the line of log.jsonl.
    void show(const TrainReport& report);

private:
    std::string text(const TrainReport& report);

    int iterations_ = 0;
    std::vector<int> phases_;  // iterations from which on iterations take longer, ascending
    int last_ = 0;             // last iteration shown
    ProgressRate pace_;
    double begin_, last_plain_ = -1e9, paused_at_ = -1;  // paused_at_ < 0: the clock runs
};

/// Iterations at which loss terms and votes begin, ascending, without the first iteration.
std::vector<int> phases_of(const TrainOptions& options);

}  // namespace tvsgs
