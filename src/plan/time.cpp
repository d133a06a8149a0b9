#include "plan/time.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/error.h"
#include "core/grouped.h"
#include "core/progress.h"
#include "optim/loop/schedule.h"

namespace tvsgs {
namespace {

constexpr int kTrial = 40, kWarmUp = 3, kFewest = 8;  // steps; fewer measure noise
constexpr double kSeconds = 5, kPatience = 20;        // of the trial; with fewer than kFewest
constexpr double kLow = 0.6, kHigh = 1.5;             // x mean, for other programs and views
constexpr double kUnseen = 2;                         // x, for later phases that take longer

template <class Device>
std::vector<double> step_ends(const Scene& scene, const TrainOptions& options) {
    std::vector<double> ends;
    const double begin = steady_seconds();
    TrainCallbacks told;
    told.report_due = [](int) { return false; };
    told.stop_requested = [&] {
        const bool enough = ends.size() > kWarmUp + kFewest;
        return steady_seconds() - begin > (enough ? kSeconds : kPatience);
    };
    const auto after_step = [&](int, const Gaussians<Device>&) {
        synchronize(Device{});
        ends.push_back(steady_seconds());
    };
    train<Device>(scene, options, told, after_step);
    return ends;
}

std::string duration(double seconds) {
    if (seconds < 120) return str(std::max(1L, std::lround(seconds)), " s");
    return str(std::lround(seconds / 60), " min");
}

}  // namespace

std::string TimePlan::text() const {
    if (steps == 0)
        return "not known: fewer than two iterations ended in the trial; the progress of a "
               "training "
               "shows it";
    return str(
        "about ", duration(low), " to ", duration(high), " for ", grouped(iterations),
        " iterations; ", steps, " took ", std::round(1e4 * each) / 10, " ms each just now, ",
        steps >= of ? "in all phases of the schedule" : "before later phases, which may be slower",
        grows ? "; longer as splats are added" : "");
}

TimePlan plan_time(const DeviceChoice& device, const Scene& scene, const TrainOptions& options) {
    TrainOptions trial = options;
    const int iterations = std::min(options.iterations, kTrial);
    fit_schedule(trial, iterations);
    const std::vector<double> ends =
        on_device(device, [&](auto tag) { return step_ends<decltype(tag)>(scene, trial); });
    TimePlan plan;
    plan.iterations = options.iterations, plan.grows = options.densify.enabled;
    if (ends.size() < 2) return plan;
    const std::size_t first = std::min<std::size_t>(kWarmUp, ends.size() - 1) - 1;
    plan.steps = int(ends.size() - 1 - first);
    plan.of = std::max(1, iterations - kWarmUp);
    plan.each = (ends.back() - ends[first]) / plan.steps;
    plan.low = kLow * plan.each * options.iterations;
    plan.high = kHigh * plan.each * options.iterations * (plan.steps < plan.of ? kUnseen : 1);
    return plan;
}

}  // namespace tvsgs
