// Every option that counts iterations, in one list: what a shorter training shortens with it.
#pragma once

#include <algorithm>
#include <cmath>

#include "optim/train.h"

namespace tvsgs {

/// From here on a number means: not within any training.
inline constexpr int kNever = 100000000;

/// What such a number says.
enum class Counts {
    at,       // at which iteration
    between,  // how many iterations lie between two
};

/// visit(key, number, Counts) for each of them. Votes are not among them: how often splats vote
/// goes by how fast they move.
template <class Options, class Visit>
void visit_schedule(Options& o, const Visit& visit) {
    visit("iterations", o.iterations, Counts::at);
    visit("model.sh_every", o.model.sh_every, Counts::between);
    visit("lr.position_max_steps", o.lr.position_max_steps, Counts::at);
    visit("loss.photometric.exposure_start", o.loss.photometric.exposure_start, Counts::at);
    visit("loss.flatten.start", o.loss.flatten.start, Counts::at);
    visit("loss.normal.start", o.loss.normal.start, Counts::at);
    visit("loss.multi_view_geometry.start", o.loss.multi_view_geometry.start, Counts::at);
    visit("loss.multi_view_ncc.start", o.loss.multi_view_ncc.start, Counts::at);
    visit("loss.tv_normal.start", o.loss.tv_normal.start, Counts::at);
    visit("loss.tv_position.start", o.loss.tv_position.start, Counts::at);
    visit("densify.from", o.densify.from, Counts::at);
    visit("densify.until", o.densify.until, Counts::at);
    visit("densify.every", o.densify.every, Counts::between);
    visit("densify.opacity_reset_every", o.densify.opacity_reset_every, Counts::between);
    visit("densify.trim_every", o.densify.trim_every, Counts::between);
    visit("tv.start", o.tv.start, Counts::at);
}

inline void copy_schedule(const TrainOptions& from, TrainOptions& to) {
    std::vector<int> numbers;
    visit_schedule(from, [&](const char*, int number, Counts) { numbers.push_back(number); });
    std::size_t next = 0;
    visit_schedule(to, [&](const char*, int& number, Counts) { number = numbers[next++]; });
}

/// The training from iteration `done` on stretched or squeezed so that it ends at `iterations`;
/// what lies before `done` stays.
inline void fit_schedule(TrainOptions& options, int iterations, int done = 0) {
    const int last = options.iterations;
    if (iterations == last || last <= done) return;
    const double ratio = static_cast<double>(iterations - done) / (last - done);
    visit_schedule(options, [&](const char*, int& number, Counts counts) {
        const int from = counts == Counts::at ? done : 0;
        if (number <= from || number >= kNever) return;
        const double fitted = from + std::round((number - from) * ratio);
        number = static_cast<int>(std::clamp(fitted, from + 1.0, static_cast<double>(kNever)));
    });
}

}  // namespace tvsgs
