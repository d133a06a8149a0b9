// How far long work is, on standard error: for whoever waits. Compiles in CUDA sources.
#pragma once

#include <cmath>
#include <deque>
#include <mutex>
#include <string>
#include <vector>

namespace tvsgs {

/// automatic: a line that rewrites itself on a terminal, else plain, a line per 10 s; json: only
/// what a training says by itself. Of the whole process; quiet until init_log() says otherwise.
enum class ProgressStyle { automatic, plain, json, quiet };
void set_progress_style(ProgressStyle style);
ProgressStyle progress_style();

/// Ends a line in place, before something else is written; removes several.
void end_progress_line();

/// How fast work goes, by what was seen of it lately.
class Pace {
public:
    /// `done` is behind it after `seconds`; both grow.
    void add(double seconds, double done);
    /// What comes is not like what was.
    void restart() { seen_.clear(); }
    /// Seconds until `total`; NaN before there is a basis: 2 s, and something done in them.
    double left(double total) const;

private:
    struct Sample {
        double seconds, done;
    };
    std::deque<Sample> seen_;  // the last 10 s, or third of all
};

/// One piece of work; it says nothing when it is over at once.
class Progress {
public:
    /// `total` steps, of any unit.
    Progress(std::string what, double total);
    ~Progress();
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;

    /// So much more is done. May be called by several threads.
    void advance(double steps = 1);

private:
    std::mutex mutex_;
    std::string what_;
    double total_, done_ = 0, begin_, shown_;
    Pace pace_;
};

/// "0:12 [####....] 40 %  left 0:18": `what` and the bar. `left` NaN: not known; `at_least`: what
/// comes later may be slower.
std::string progress_text(
    const std::string& what, double seconds, double share, double left, bool at_least = false);

/// Whether lines rewrite themselves: on a terminal, where the style says so.
bool progress_in_place();

/// Shows lines; in place they replace those that were shown last, and end at the terminal's rim.
void show_progress_lines(const std::vector<std::string>& lines);
inline void show_progress_line(const std::string& text) {
    show_progress_lines({text});
}

/// Seconds since some moment.
double steady_seconds();

}  // namespace tvsgs
