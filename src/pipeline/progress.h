// The progress of a run for a person at a terminal, for a log, or for a program.
#pragma once

#include <string>

#include "optim/train.h"

namespace tvsgs {

class Progress {
public:
    /// `style`: auto (a line in place on a terminal, else plain), plain (a line per 10 s), json (a
    /// line per report on standard error), quiet.
    /// A run that goes on has `seconds` behind it.
    Progress(int iterations, const std::string& style, double seconds = 0);

    void set_iterations(int iterations) { iterations_ = iterations; }

    /// Seconds of training: since the start, without pauses.
    double seconds() const;

    /// From here to resume() the clock stands still.
    void pause();
    void resume();

    /// The line of log.jsonl.
    std::string json(const TrainReport& report) const;

    void show(const TrainReport& report);

    /// Ends the line in place.
    void finish();

private:
    enum class Style { line, plain, json, quiet };
    std::string text(const TrainReport& report) const;

    int iterations_;
    Style style_;
    double begin_, last_plain_ = -1e9, paused_at_ = -1;  // paused_at_ < 0: it runs
    bool line_open_ = false;
};

}  // namespace tvsgs
