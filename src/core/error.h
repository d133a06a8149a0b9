// Exception type of all commands, with the exit code that the user sees.
#pragma once

#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

namespace tvsgs {

/// Exit codes of all commands (docs/guide/commands.md).
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

/// Replaces control characters except line ends by '?'. Parts of a message come from files and must
/// not control the terminal.
inline std::string printable(std::string text) {
    for (char& c : text)
        if ((static_cast<unsigned char>(c) < 32 && c != '\n') || c == 127) c = '?';
    return text;
}

/// A message says where the error is, what was found, what was expected and what to do.
class Error : public std::runtime_error {
public:
    /// Concatenates the parts of the message.
    template <class... Parts>
    explicit Error(ExitCode code, const Parts&... parts)
        : std::runtime_error(printable(str(parts...))), code_(code) {}
    ExitCode code() const { return code_; }

private:
    ExitCode code_;
};

/// `what` says what was needed and what was available; the function adds advice.
inline Error out_of_memory(const std::string& what) {
    return Error(ExitCode::memory, "out of memory: ", what,
                 "; use fewer splats (--max-gaussians), smaller images (-r), or compact lists "
                 "of votes (--set tv.lists=compact)");
}

/// Runs `action`. An Error that passes through gains a line with the current activity `doing`.
template <class Action>
decltype(auto) with_context(const std::string& doing, Action&& action) {
    try {
        return std::forward<Action>(action)();
    } catch (const Error& error) {
        throw Error(error.code(), error.what(), "\n  while ", doing);
    }
}

}  // namespace tvsgs
