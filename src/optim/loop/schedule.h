// Lists all options that count iterations, and scales them to a new number of iterations.
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

}  // namespace tvsgs
