// Fits the schedule of a running training into a given time.
#pragma once

#include "optim/loop/schedule.h"

namespace tvsgs {

class TimeBudget {
public:
    /// For a training that has done `done` iterations and may run until `seconds`; 0: no budget.
    TimeBudget(double seconds, const TrainOptions& options, int done)
        : seconds_(seconds), original_(options), from_(done), fitted_at_(done) {}

    /// Whether the schedule should be fitted again, after `done` iterations and `seconds`.
    bool due(int done, double seconds) {
        // Start-up time is not counted.
        if (at_ < 0) at_ = seconds, done_ = done;
        if (!(seconds_ > 0) || done == done_) return false;
        // The first iterations can be much slower than the rest.
        const int last = fitted_at_ + planned_;
        if (planned_ > 0 && last - done <= 1 + planned_ / 10 && seconds < 0.8 * seconds_)
            return true;
        if (next_ >= kLooks || seconds < kShares[next_] * seconds_) return false;
        // A few iterations give a poor speed estimate, unless they are slow.
        return done - done_ >= kFewest || seconds - at_ > 0.05 * seconds_;
    }

    /// Fits the remaining iterations into the remaining time, at the speed since the last fit; at
    /// most as many as in the original schedule.
    void fit(int done, double seconds, TrainOptions& options) {
        const double speed = (done - done_) / std::max(seconds - at_, 1e-6);
        const double last = original_.iterations,
                     left = std::max(std::floor((seconds_ - seconds) * speed), 1.0);
        from_ = std::min(from_ + (done - fitted_at_) * rate_, last - 1);
        const int iterations = done + int(std::min(left, last - done));
        fit_schedule(original_, from_, options, done, iterations);
        planned_ = iterations - done;
        rate_ = (last - from_) / planned_;
        fitted_at_ = done, at_ = -1;
        while (next_ < kLooks && seconds >= kShares[next_] * seconds_) ++next_;
    }

private:
    // Fractions of the budget: early, before plans exceed the time, and late, to end on time.
    static constexpr double kShares[] = {0.03, 0.12, 0.35, 0.65, 0.88};
    static constexpr int kLooks = 5, kFewest = 20;

    double seconds_;
    TrainOptions original_;
    double from_;      // iteration of the original schedule at the last fit
    int fitted_at_;    // iteration of the training at the last fit
    double rate_ = 1;  // iterations of the original schedule per iteration since then
    int planned_ = 0;  // iterations of the training from the last fit on; 0: no fit yet
    int next_ = 0, done_ = 0;
    double at_ = -1;  // seconds at iteration `done_`; -1: not measured since the last fit
};

}  // namespace tvsgs
