// Signals that ask a command to end.
#pragma once

namespace tvsgs {

/// Thrown where a command gives way to a signal.
struct Stopped {
    int signal;
};

/// From here on they end the command at once, without leaving temporary files.
void end_on_signals();

/// While it lives, the signals that ask a command to end (SIGINT, SIGTERM, SIGHUP) are only noted,
/// so that it can save its work; a second one, 0.1 s later or more, ends it at once, as the first
/// does otherwise, without leaving temporary files.
class SignalGuard {
public:
    SignalGuard();
    SignalGuard(const SignalGuard&) = delete;
    SignalGuard& operator=(const SignalGuard&) = delete;
    ~SignalGuard();

    static int received();  ///< the first signal; 0: none

    /// Ends the command with the signal's exit code if one has arrived. To be called where nothing
    /// is half done.
    static void check();
};

}  // namespace tvsgs
