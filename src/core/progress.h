// Progress of long work on standard error. Compiles in CUDA sources.
#pragma once

#include <deque>
#include <mutex>
#include <string>
#include <vector>

namespace tvsgs {

/// automatic: on a terminal a line that is rewritten in place, else as plain; plain: a line every
/// 10 s; json: only the training's own JSON lines. The style holds for the whole process and is
/// quiet until init_log().
enum class ProgressStyle { automatic, plain, json, quiet };
void set_progress_style(ProgressStyle style);
ProgressStyle progress_style();

/// Ends the lines shown in place before other output; removes them if there are several.
void end_progress_line();

/// Speed of the work, measured over the recent past.
class ProgressRate {
public:
    /// Records that `done` is complete after `seconds`. Both must not decrease.
    void add(double seconds, double done);
    /// Forgets the measured speed.
    void restart() { seen_.clear(); }
    /// Seconds until `total` is done; NaN before 2 s have passed with some progress.
    double left(double total) const;

private:
    struct Sample {
        double seconds, done;
    };
    std::deque<Sample> seen_;  // the last 10 s, or the last third if that is longer
};

/// Progress of one piece of work. Shows nothing if the work is short.
class Progress {
public:
    /// `total`: number of steps, of any unit.
    Progress(std::string what, double total);
    ~Progress();
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;

    /// Records that `steps` more are done. Several threads may call it.
    void advance(double steps = 1);

private:
    std::mutex mutex_;
    std::string what_;
    double total_, done_ = 0, begin_, shown_;
    ProgressRate pace_;
};

/// Seconds as a clock shows them: 65 -> "1:05".
std::string clock_text(double seconds);

/// Returns "0:12 [####....] 40 %  about 0:18 left" preceded by `what`. `left` NaN: unknown.
/// `at_least`: later work may be slower, so `left` is a lower bound.
std::string progress_text(
    const std::string& what, double seconds, double share, double left, bool at_least = false);

/// True on a terminal if the style rewrites lines in place.
bool progress_in_place();

/// Shows lines, cut at the width of the terminal. In place they replace the lines shown last.
void show_progress_lines(const std::vector<std::string>& lines);
inline void show_progress_line(const std::string& text) {
    show_progress_lines({text});
}

/// Seconds of a steady clock since an arbitrary moment.
double steady_seconds();

}  // namespace tvsgs
