// One exception type for whatever stops a command, with the exit code the user sees.
#pragma once

#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

namespace tvsgs {

/// Exit codes of all commands (docs/commands.md).
enum class ExitCode {
    done = 0,
    internal = 1,
    usage = 2,
    input = 3,
    memory = 4,
    device = 5,
    io = 6,
    numerical = 7,
    bound = 8,
};

/// Concatenates its arguments as text.
template <class... Parts>
std::string str(const Parts&... parts) {
    std::ostringstream out;
    (out << ... << parts);
    return out.str();
}

/// A message says where, what was found, what was expected and what to do.
class Error : public std::runtime_error {
public:
    Error(ExitCode code, const std::string& message) : std::runtime_error(message), code_(code) {}
    ExitCode code() const { return code_; }

private:
    ExitCode code_;
};

/// Runs `action`; an Error passing through gains a line that says what was being done.
template <class Action>
decltype(auto) with_context(const std::string& doing, Action&& action) {
    try {
        return std::forward<Action>(action)();
    } catch (const Error& error) {
        throw Error(error.code(), str(error.what(), "\n  while ", doing));
    }
}

}  // namespace tvsgs
