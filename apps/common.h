// What all commands share: flags, the device switch, signals, and one place where exceptions become
// messages and exit codes.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <vector>

#include "core/cuda_device.h"
#include "core/device.h"
#include "core/error.h"
#include "core/log.h"
#include "core/version.h"

namespace tvsgs {

/// For flags that ask for a number above 0.
extern const CLI::Validator kPositive;

/// Parses with '_' and '-' alike in long flags; of a flag given twice the last counts. Errors
/// become Error(ExitCode::usage); an unknown flag names the nearest one.
void parse_command_line(CLI::App& app, int argc, char** argv);

/// A flag for a file to write, which may replace none but ours: said before any work is done.
CLI::Option* add_output_flag(CLI::App& app,
                             const std::string& names,
                             std::string& file,
                             const std::string& description);

/// Positive numbers with commas between. Throws Error(ExitCode::usage) naming the flag.
std::vector<double> parse_numbers(const std::string& flag, const std::string& text);

/// A number of bytes with an optional suffix K, M, G or T, powers of 1024. Throws
/// Error(ExitCode::usage) naming the flag or key.
std::int64_t parse_bytes(const std::string& flag, const std::string& text);

/// "auto" is the first GPU when there is a usable one and the build has CUDA, else the CPU; "cpu";
/// "cuda"; "cuda:N". Throws Error(ExitCode::device).
struct DeviceChoice {
    bool cuda = false;
    std::string description;
};
DeviceChoice choose_device(const std::string& name);

/// The one switch between the devices: calls action(Cpu{}) or action(Cuda{}).
template <class Action>
auto on_device(const DeviceChoice& device, Action&& action) {
    if constexpr (kHasCuda) {
        if (device.cuda) return action(Cuda{});
    }
    return action(Cpu{});
}

/// While it lives, the signals that ask a command to end (SIGINT, SIGTERM, SIGHUP) are only noted,
/// so that it can save its work; a second one ends it at once, as the first does otherwise, without
/// leaving temporary files.
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

/// Runs a command; every exception ends as one message on standard error and the exit code of its
/// kind.
int run_command(const std::function<int()>& command);

}  // namespace tvsgs
