// Runs other programs and keeps their output in a file.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace tvsgs::prepare {

/// Path of a program on PATH; empty: not found.
std::string find_program(const std::string& name);

/// Runs `command` without display and input. Appends its output to the file `log` and passes each
/// line to `on_line`, and an empty line every 200 ms or more often. Returns its exit code, or 128 +
/// the signal that ended it. Throws Stopped if a SignalGuard has noted a signal, after the program
/// has ended. Throws Error(ExitCode::io) if the log cannot be written or no process can be made.
int run_program(const std::vector<std::string>& command,
                const std::string& log,
                const std::function<void(std::string_view)>& on_line);

/// The last lines of a file, for messages.
std::string last_lines(const std::string& file, int count);

}  // namespace tvsgs::prepare
