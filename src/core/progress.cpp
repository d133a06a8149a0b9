#include "core/progress.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <utility>

#include "core/log.h"

namespace tvsgs {
namespace {

constexpr double kBasis = 2, kWindow = 10;    // seconds
constexpr double kFirst = 1, kRefresh = 0.2;  // seconds; for a line in place
constexpr double kSparse = 10;                // seconds between plain lines
std::atomic<ProgressStyle> style = ProgressStyle::quiet;
std::atomic<int> lines_open = 0;

/// Moves the cursor to the first of `lines` lines.
void go_up(int lines) {
    if (lines > 1) std::fprintf(stderr, "\033[%dA", lines - 1);
    std::fputc('\r', stderr);
}

}  // namespace

void set_progress_style(ProgressStyle chosen) {
    style = chosen;
}

std::string clock_text(double seconds) {
    const long total = std::lround(std::min(seconds, 1e9)), minutes = total / 60;
    return total >= 3600 ? fmt::format("{}:{:02}:{:02}", minutes / 60, minutes % 60, total % 60)
                         : fmt::format("{}:{:02}", minutes, total % 60);
}

ProgressStyle progress_style() {
    return style;
}

bool progress_in_place() {
    return style == ProgressStyle::automatic && isatty(STDERR_FILENO) != 0;
}

void end_progress_line() {
    const int lines = lines_open.exchange(0);
    if (lines == 1) std::fputc('\n', stderr);
    if (lines < 2) return;
    go_up(lines);
    std::fputs("\033[J", stderr);
}

void show_progress_lines(const std::vector<std::string>& lines) {
    if (!progress_in_place()) {
        for (const std::string& line : lines) std::fprintf(stderr, "%s\n", line.c_str());
        return;
    }
    winsize size{};
    const bool known = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0;
    const std::size_t rows = known && size.ws_row > 1 ? size.ws_row - 1u : lines.size(),
                      columns = known && size.ws_col > 1 ? size.ws_col - 1u : std::string::npos;
    const auto shown = static_cast<int>(std::min(lines.size(), rows));
    go_up(lines_open.exchange(shown));
    for (int i = 0; i < shown; ++i)
        std::fprintf(stderr, "%s%s\033[K", i > 0 ? "\n" : "", lines[i].substr(0, columns).c_str());
    std::fputs("\033[J", stderr);
    std::fflush(stderr);
}

double steady_seconds() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

void ProgressRate::add(double seconds, double done) {
    seen_.push_back({seconds, done});
    const double since = seconds - std::max(kWindow, seconds / 3);
    while (seen_.size() > 2 && seen_[1].seconds <= since) seen_.pop_front();
}

double ProgressRate::left(double total) const {
    if (seen_.empty()) return NAN;
    const double seconds = seen_.back().seconds - seen_.front().seconds,
                 done = seen_.back().done - seen_.front().done;
    if (!(seconds >= kBasis) || !(done > 0)) return NAN;
    return std::max(0.0, total - seen_.back().done) * seconds / done;
}

std::string progress_text(
    const std::string& what, double seconds, double share, double left, bool at_least) {
    constexpr int kBar = 20;
    const double part = std::isfinite(share) ? std::clamp(share, 0.0, 1.0) : 1;
    const int filled = static_cast<int>(kBar * part);
    std::string text = fmt::format(
        "{}{}{} [{}{}] {} %", what, what.empty() ? "" : " ", clock_text(seconds),
        std::string(static_cast<std::size_t>(filled), '#'),
        std::string(static_cast<std::size_t>(kBar - filled), '.'), static_cast<int>(100 * part));
    if (std::isfinite(left))
        text += (at_least ? "  more than " : "  about ") + clock_text(left) + " left";
    return text;
}

Progress::Progress(std::string what, double total)
    : what_(std::move(what)), total_(total), begin_(steady_seconds()), shown_(begin_) {
    pace_.add(0, 0);
}

Progress::~Progress() {
    end_progress_line();
}

void Progress::advance(double steps) {
    const std::lock_guard lock(mutex_);
    done_ += steps;
    const double now = steady_seconds();
    pace_.add(now - begin_, done_);
    const bool quiet = style == ProgressStyle::quiet || style == ProgressStyle::json;
    const double wait = !progress_in_place() ? kSparse : shown_ > begin_ ? kRefresh : kFirst;
    if (quiet || now - shown_ < wait) return;
    shown_ = now;
    show_progress_line(progress_text(what_, now - begin_, done_ / total_, pace_.left(total_)));
}

}  // namespace tvsgs
