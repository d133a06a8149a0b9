// Handles signals that end a command.
#pragma once

namespace tvsgs {

/// Thrown when a command ends because of a signal.
struct Stopped {
    int signal;
};

/// Makes these signals end the command at once, and removes temporary files.
void end_on_signals();

/// While it lives, terminating signals (SIGINT, SIGTERM, SIGHUP) are only recorded, so that the
/// command can save its work. A second one, at least 0.1 s later, ends the command at once and
/// removes temporary files.
class SignalGuard {
public:
    SignalGuard();
    SignalGuard(const SignalGuard&) = delete;
    SignalGuard& operator=(const SignalGuard&) = delete;
    ~SignalGuard();

    static int received();  ///< the first signal; 0: none

    /// Ends the command with the signal's exit code if one has arrived. Call it where no work is
    /// half done.
    static void check();
};

}  // namespace tvsgs
