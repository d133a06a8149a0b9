#include "pipeline/run/signals.h"

#include <csignal>
#include <ctime>

#include "io/files/atomic_file.h"

namespace tvsgs {
namespace {

constexpr int kEndingSignals[] = {SIGINT, SIGTERM, SIGHUP};

constexpr double kRepeatSeconds = 0.1;  // seconds: `timeout` sends its signal twice at once
volatile std::sig_atomic_t first_signal = 0;
double first_at = 0;  // seconds on the monotonic clock

extern "C" void end_at_once(int signal) {
    remove_temporary_files();
    std::signal(signal, SIG_DFL);
    std::raise(signal);
}

/// A second signal ends the command without waiting for the save.
extern "C" void record_signal(int signal) {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    const double at = double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
    if (first_signal != 0) {
        if (at - first_at > kRepeatSeconds) end_at_once(signal);
        return;
    }
    first_at = at;
    first_signal = signal;
}

/// Keeps SIGHUP ignored under nohup.
void handle_ending_signals(void (*handler)(int)) {
    for (const int signal : kEndingSignals) {
        struct sigaction now {};
        if (sigaction(signal, nullptr, &now) != 0 ||
            (signal == SIGHUP && now.sa_handler == SIG_IGN))
            continue;
        struct sigaction action {};
        action.sa_handler = handler;
        action.sa_flags = SA_RESTART;  // an interrupted write continues
        sigaction(signal, &action, nullptr);
    }
}

}  // namespace

void end_on_signals() {
    handle_ending_signals(end_at_once);
}

SignalGuard::SignalGuard() {
    first_signal = 0;
    handle_ending_signals(record_signal);
}

SignalGuard::~SignalGuard() {
    handle_ending_signals(end_at_once);
}

int SignalGuard::received() {
    return first_signal;
}

void SignalGuard::check() {
    if (const int signal = received()) throw Stopped{signal};
}

}  // namespace tvsgs
