// Other programs, run as a user would, with what they say kept in a file.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace tvsgs::prepare {

/// The file of that name on PATH; empty: there is none.
std::string find_program(const std::string& name);

/// Runs `command` without a display and without input; what it writes is added to the file `log`,
/// and goes line by line to `on_line`. Returns its exit code, 128 + the signal that ended it.
/// Throws Stopped when a SignalGuard has noted a signal; the program has ended then. Throws
/// Error(ExitCode::io) where the log cannot be written or no process can be made.
int run_program(const std::vector<std::string>& command,
                const std::string& log,
                const std::function<void(std::string_view)>& on_line);

/// The last lines of a file, for messages.
std::string last_lines(const std::string& file, int count);

}  // namespace tvsgs::prepare
