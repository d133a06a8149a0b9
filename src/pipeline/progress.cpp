#include "pipeline/progress.h"

#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>

#include "io/config.h"

namespace tvsgs {
namespace {

double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

/// 65 -> "1:05".
std::string clock_text(double seconds) {
    const auto total = static_cast<long>(std::lround(seconds));
    char text[32];
    if (total >= 3600)
        std::snprintf(text, sizeof text, "%ld:%02ld:%02ld", total / 3600, total / 60 % 60,
                      total % 60);
    else
        std::snprintf(text, sizeof text, "%ld:%02ld", total / 60, total % 60);
    return text;
}

}  // namespace

Progress::Progress(int iterations, const std::string& style, double seconds)
    : iterations_(iterations),
      style_(style == "quiet"        ? Style::quiet
             : style == "json"       ? Style::json
             : style == "plain"      ? Style::plain
             : isatty(STDERR_FILENO) ? Style::line
                                     : Style::plain),
      begin_(now() - seconds) {}

double Progress::seconds() const {
    return (paused_at_ < 0 ? now() : paused_at_) - begin_;
}

void Progress::pause() {
    finish();  // others write messages now
    if (paused_at_ < 0) paused_at_ = now();
}

void Progress::resume() {
    if (paused_at_ >= 0) begin_ += now() - paused_at_;
    paused_at_ = -1;
}

std::string Progress::json(const TrainReport& report) const {
    JsonLine line;
    line.add("iteration", report.step)
        .add("seconds", seconds())
        .add("loss", report.loss)
        .add("gaussians", report.gaussians);
    line.add("bytes", report.memory.current_bytes).add("peak_bytes", report.memory.peak_bytes);
    JsonLine terms, stages;
    for (const auto& [name, value] : report.terms) terms.add(name, value);
    line.add_json("terms", terms.text());
    for (const StageTime& stage : report.stages) stages.add(stage.name, stage.seconds);
    if (!report.stages.empty()) line.add_json("stage_seconds", stages.text());
    return line.text();
}

std::string Progress::text(const TrainReport& report) const {
    const double elapsed = seconds(), rate = report.step / std::max(elapsed, 1e-9);
    constexpr int kBar = 20;
    const int filled = iterations_ > 0
                           ? static_cast<int>(static_cast<long>(kBar) * report.step / iterations_)
                           : kBar;
    const std::string bar = std::string(static_cast<std::size_t>(filled), '#') +
                            std::string(static_cast<std::size_t>(kBar - filled), '.');
    char line[256];
    std::snprintf(
        line, sizeof line, "%s [%s] %d/%d  %.1f it/s  left %s  loss %.5f  %d splats  %ld MiB",
        clock_text(elapsed).c_str(), bar.c_str(), report.step, iterations_, rate,
        clock_text((iterations_ - report.step) / std::max(rate, 1e-9)).c_str(), report.loss,
        report.gaussians, static_cast<long>(report.memory.current_bytes >> 20));
    return line;
}

void Progress::show(const TrainReport& report) {
    switch (style_) {
        case Style::quiet:
            return;
        case Style::json:
            std::fprintf(stderr, "%s\n", json(report).c_str());
            return;
        case Style::line:
            std::fprintf(stderr, "\r%s\033[K", text(report).c_str());
            std::fflush(stderr);
            line_open_ = true;
            return;
        case Style::plain:
            if (seconds() - last_plain_ < 10 && report.step != iterations_) return;
            last_plain_ = seconds();
            std::fprintf(stderr, "%s\n", text(report).c_str());
    }
}

void Progress::finish() {
    if (line_open_) std::fputc('\n', stderr);
    line_open_ = false;
}

}  // namespace tvsgs
