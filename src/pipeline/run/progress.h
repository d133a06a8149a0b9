// The progress of a training for a person at a terminal, for a log, or for a program.
#pragma once

#include <string>
#include <vector>

#include "core/progress.h"
#include "io/files/json_value.h"
#include "optim/loop/train.h"

namespace tvsgs {

class TrainProgress {
public:
    /// A run that goes on has `seconds` behind it.
    explicit TrainProgress(const TrainOptions& options, double seconds = 0);

    /// Another schedule.
    void set_schedule(const TrainOptions& options);

    /// Seconds of training: since the start, without pauses.
    double seconds() const;

    /// From here to resume() the clock stands still.
    void pause();
    void resume();

    /// The line of log.jsonl.
    JsonValue json(const TrainReport& report) const;

    /// As progress_style() says; with json the line of log.jsonl.
    void show(const TrainReport& report);

private:
    std::string text(const TrainReport& report);

    int iterations_ = 0;
    std::vector<int> phases_;  // iterations from which on an iteration takes longer, ascending
    int last_ = 0;             // iteration that was shown
    Pace pace_;
    double begin_, last_plain_ = -1e9, paused_at_ = -1;  // paused_at_ < 0: it runs
};

/// Where terms of the loss and votes set in, ascending, without the first iteration.
std::vector<int> phases_of(const TrainOptions& options);

}  // namespace tvsgs
