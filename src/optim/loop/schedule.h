// Lists all options that count iterations, and scales them to a new number of iterations, or to a
// given time.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/error.h"
#include "optim/loop/train.h"

namespace tvsgs {

/// An iteration number from here on means: never.
inline constexpr int kNever = 100000000;

/// Meaning of an option that counts iterations.
enum class Counts {
    at,       // an iteration
    between,  // a number of iterations between two events
};

/// Calls visit(key, number, Counts) for each such option. Options of voting are not among them:
/// splats vote as often as their speed requires.
template <class Options, class Visit>
void visit_schedule(Options& o, const Visit& visit) {
    visit("iterations", o.iterations, Counts::at);
    visit("model.sh_every", o.model.sh_every, Counts::between);
    visit("lr.position_max_steps", o.lr.position_max_steps, Counts::at);
    LossOptions::terms(o.loss, [&](auto, const char* term, auto& options, auto) {
        options.first_iterations(options, [&](const char* key, auto& number) {
            visit(str("loss.", term, ".", key), number, Counts::at);
        });
    });
    visit("cameras.start", o.cameras.start, Counts::at);
    visit("densify.from", o.densify.from, Counts::at);
    visit("densify.until", o.densify.until, Counts::at);
    visit("densify.every", o.densify.every, Counts::between);
    visit("densify.opacity_reset_every", o.densify.opacity_reset_every, Counts::between);
    visit("densify.trim_every", o.densify.trim_every, Counts::between);
    visit("densify.prune_large_after", o.densify.prune_large_after, Counts::at);
    visit("tv.start", o.tv.start, Counts::at);
}

/// The numbers, in the order of visit_schedule().
inline std::vector<int> schedule_numbers(const TrainOptions& options) {
    std::vector<int> numbers;
    visit_schedule(options,
                   [&](const std::string&, int number, Counts) { numbers.push_back(number); });
    return numbers;
}

inline void copy_schedule(const TrainOptions& from, TrainOptions& to) {
    const std::vector<int> numbers = schedule_numbers(from);
    std::size_t next = 0;
    visit_schedule(to, [&](const std::string&, int& number, Counts) { number = numbers[next++]; });
}

/// Smallest intervals of a shortened training, in iterations, unless the original has shorter ones:
/// growth needs statistics of several views, new and reset splats need time to settle.
inline constexpr int kLeastGrowth = 100, kLeastTrim = 500, kLeastReset = 1000, kSettling = 1000;

/// Ends growth early enough for splats to settle; none is left where the time is too short.
inline void keep_intervals(const TrainOptions& original, DensifyOptions& fitted, int iterations) {
    const auto at_least = [](int& number, int was, int least) {
        number = std::max(number, std::min(was, least));
    };
    at_least(fitted.every, original.densify.every, kLeastGrowth);
    at_least(fitted.trim_every, original.densify.trim_every, kLeastTrim);
    at_least(fitted.opacity_reset_every, original.densify.opacity_reset_every, kLeastReset);
    const int settling = std::clamp(original.iterations - iterations, 0, kSettling);
    fitted.until = std::clamp(fitted.until, 0, std::max(iterations - settling, 0));
}

/// Gives `options` the schedule of `original` from its iteration `from` on, scaled to run from
/// iteration `done` to `iterations`. Numbers before `from` stay.
inline void fit_schedule(
    const TrainOptions& original, double from, TrainOptions& options, int done, int iterations) {
    const double ratio = (iterations - done) / (original.iterations - from);
    const std::vector<int> numbers = schedule_numbers(original);
    std::size_t next = 0;
    visit_schedule(options, [&](const std::string&, int& number, Counts counts) {
        const int was = numbers[next++];
        const double begin = counts == Counts::at ? std::max(from, 1.0) : 0;
        if (was <= begin || was >= kNever) return;
        const double fitted = counts == Counts::at ? done + (was - from) * ratio : was * ratio;
        number = int(std::clamp(std::round(fitted), 1.0, 1.0 * kNever));
    });
    if (ratio < 1) keep_intervals(original, options.densify, iterations);
    options.iterations = iterations;
}

/// Scales the whole schedule to end at `iterations`.
inline void fit_schedule(TrainOptions& options, int iterations) {
    const TrainOptions original = options;
    if (original.iterations > 0 && iterations != original.iterations)
        fit_schedule(original, 0, options, 0, iterations);
}

/// Fits the schedule of a running training into a given time.
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
