#include "pipeline/signals.h"

#include <csignal>

#include "io/atomic_file.h"

namespace tvsgs {
namespace {

constexpr int kEndingSignals[] = {SIGINT, SIGTERM, SIGHUP};

volatile std::sig_atomic_t first_signal = 0;
int noted_signal = 0;  // of another process

extern "C" void end_at_once(int signal) {
    remove_temporary_files();
    std::signal(signal, SIG_DFL);
    std::raise(signal);
}

/// Who sends a second one does not want to wait.
extern "C" void note_signal(int signal) {
    if (first_signal != 0) return end_at_once(signal);
    first_signal = signal;
}

/// Under nohup, SIGHUP stays ignored.
void on_ending_signals(void (*handler)(int)) {
    for (const int signal : kEndingSignals) {
        struct sigaction now {};
        if (sigaction(signal, nullptr, &now) != 0 ||
            (signal == SIGHUP && now.sa_handler == SIG_IGN))
            continue;
        struct sigaction action {};
        action.sa_handler = handler;
        action.sa_flags = SA_RESTART;  // a write that is interrupted goes on
        sigaction(signal, &action, nullptr);
    }
}

}  // namespace

void end_on_signals() {
    on_ending_signals(end_at_once);
}

SignalGuard::SignalGuard() {
    first_signal = 0, noted_signal = 0;
    on_ending_signals(note_signal);
}

SignalGuard::~SignalGuard() {
    on_ending_signals(end_at_once);
}

int SignalGuard::received() {
    return first_signal != 0 ? first_signal : noted_signal;
}

void SignalGuard::note(int signal) {
    noted_signal = signal;
}

void SignalGuard::check() {
    if (const int signal = received()) throw Stopped{signal};
}

}  // namespace tvsgs
