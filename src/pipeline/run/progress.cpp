#include "pipeline/run/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string_view>

#include "core/error.h"
#include "core/log.h"
#include "optim/loop/schedule.h"

namespace tvsgs {

std::vector<int> phases_of(const TrainOptions& options) {
    std::vector<int> phases;
    LossOptions::terms(options.loss, [&](auto, std::string_view key, const auto& term, auto) {
        if (!(term.weight > 0) || key == "photometric") return;
        term.first_iterations(term, [&](const char*, int first) { phases.push_back(first); });
    });
    if (options.tv.enabled) phases.push_back(options.tv.start);
    std::erase_if(phases, [&](int at) { return at <= 1 || at > options.iterations; });
    std::ranges::sort(phases);
    return phases;
}

TrainProgress::TrainProgress(const TrainOptions& options, double seconds)
    : begin_(steady_seconds() - seconds) {
    set_schedule(options);
}

void TrainProgress::set_schedule(const TrainOptions& options) {
    iterations_ = options.iterations, phases_ = phases_of(options);
}

double TrainProgress::seconds() const {
    return (paused_at_ < 0 ? steady_seconds() : paused_at_) - begin_;
}

void TrainProgress::pause() {
    end_progress_line();  // other code logs messages now
    if (paused_at_ < 0) paused_at_ = steady_seconds();
}

void TrainProgress::resume() {
    if (paused_at_ >= 0) begin_ += steady_seconds() - paused_at_;
    paused_at_ = -1;
}

JsonValue TrainProgress::json(const TrainReport& report) const {
    JsonValue line;
    line.add("iteration", report.step)
        .add("seconds", seconds())
        .add("loss", report.loss)
        .add("gaussians", report.gaussians);
    line.add("bytes", report.memory.current_bytes).add("peak_bytes", report.memory.peak_bytes);
    JsonValue terms = JsonValue::object(), stages;
    for (const auto& [name, value] : report.terms) terms.add(name, value);
    line.add("terms", terms);
    for (const StageTime& stage : report.stages) stages.add(stage.name, stage.seconds);
    if (!report.stages.empty()) line.add("stage_seconds", stages);
    return line;
}

std::string TrainProgress::text(const TrainReport& report) {
    const auto ahead = std::ranges::upper_bound(phases_, report.step);
    if (ahead != std::ranges::upper_bound(phases_, last_) || report.step < last_) pace_.restart();
    last_ = report.step;
    pace_.add(seconds(), report.step);
    const double left = pace_.left(iterations_);
    const int share = iterations_ > 0 ? int(100.0 * report.step / iterations_) : 100;
    std::string line =
        fmt::format("{:3} %  {}/{}  {}", share, report.step, iterations_, clock_text(seconds()));
    if (std::isfinite(left) && report.step < iterations_)
        line +=
            str(ahead != phases_.end() ? ", more than " : ", about ", clock_text(left), " left");
    if (!spdlog::should_log(spdlog::level::debug)) return line;
    if (left > 0) line += fmt::format("  {:.1f} it/s", (iterations_ - report.step) / left);
    return line + fmt::format("  loss {:.5f}  {} splats  {} MiB", report.loss, report.gaussians,
                              report.memory.current_bytes >> 20);
}

void TrainProgress::show(const TrainReport& report) {
    const ProgressStyle style = progress_style();
    if (style == ProgressStyle::quiet) return;
    if (style == ProgressStyle::json) {
        std::fprintf(stderr, "%s\n", json_text(json(report)).c_str());
        return;
    }
    const std::string line = text(report);  // every report updates the pace
    const bool plain = style == ProgressStyle::plain || isatty(STDERR_FILENO) == 0;
    if (plain && seconds() - last_plain_ < 10 && report.step != iterations_) return;
    last_plain_ = seconds();
    show_progress_line(line);
}

}  // namespace tvsgs
