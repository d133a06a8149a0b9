// Fits the schedule of a training into a given time, again and again while it runs.
#pragma once

#include "optim/schedule.h"

namespace tvsgs {

class TimeBudget {
public:
    /// 0 seconds: no budget.
    TimeBudget(double seconds, const TrainOptions& options)
        : seconds_(seconds), iterations_(options.iterations) {}

    /// Whether the schedule is to be fitted anew; after `done` iterations and that many seconds.
    bool due(int done, double seconds) {
        // Getting under way is not counted, nor what too few iterations say of the speed.
        if (at_ < 0) at_ = seconds, done_ = done;
        return seconds_ > 0 && next_ < kLooks && seconds >= kShares[next_] * seconds_ &&
               done - done_ >= kFewest;
    }

    /// Fits what remains into the time that remains, at the speed since the last look; never longer
    /// than the schedule was at first.
    void fit(int done, double seconds, TrainOptions& options) {
        const double speed = (done - done_) / std::max(seconds - at_, 1e-6);
        const double left = std::max(seconds_ - seconds, 0.0) * speed;
        while (next_ < kLooks && seconds >= kShares[next_] * seconds_) ++next_;
        at_ = -1;
        const int fitted = done + static_cast<int>(std::min(left, 1e9));
        fit_schedule(options, std::clamp(fitted, done + 1, std::max(iterations_, done + 1)), done);
    }

private:
    // Early, before much is planned for a time that is not there, and late, to end on time.
    static constexpr double kShares[] = {0.03, 0.12, 0.35, 0.65, 0.88};
    static constexpr int kLooks = 5, kFewest = 20;

    double seconds_;
    int iterations_;
    int next_ = 0, done_ = 0;
    double at_ = -1;  // of the first iteration since the last look
};

}  // namespace tvsgs
