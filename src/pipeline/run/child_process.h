// Runs another program: starts it, reads its output line by line, and sends signals.
#pragma once

#include <sys/types.h>

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tvsgs {

/// A program that runs beside this one, without input. Standard output and standard error share a
/// pipe. It receives SIGTERM when this process dies.
class ChildProcess {
public:
    struct Command {
        std::vector<std::string> words;        // first: path of the program
        std::vector<std::string> environment;  // "NAME=value"; replaces variables of that name
        bool own_group = false;  // shields it from signals of the terminal, such as Ctrl-C
    };

    /// Throws Error(ExitCode::io) where no process can be created. A program that cannot be started
    /// exits with 127.
    explicit ChildProcess(const Command& command);
    ChildProcess(const ChildProcess&) = delete;
    ChildProcess& operator=(const ChildProcess&) = delete;
    /// Kills the program if it still runs.
    ~ChildProcess();

    /// File descriptor of the pipe for polling; -1 after its end.
    int output() const { return output_; }

    /// Calls `on_line` for each line written since the last call, without waiting. Lines end at
    /// '\n' or '\r'.
    void read_lines(const std::function<void(std::string_view)>& on_line);

    /// Exit code, or 128 + N after signal N; nothing while it runs. Lines may still be unread.
    std::optional<int> exit_code();

    void send(int signal) const;

private:
    pid_t pid_ = 0;
    int output_ = -1;
    std::string line_;  // incomplete last line
    std::optional<int> code_;
};

/// "exit code 3", or "ended by signal 9 (Killed), often out of memory".
std::string ending_text(int code);

/// The last message of a program, from the lines that it wrote: the first lines of its last error,
/// or its last line.
class LastMessage {
public:
    void add(std::string_view line);
    std::string text() const;  // lines with '\n' between them

private:
    std::vector<std::string> lines_;
};

/// Appends lines to a file. Throws Error(ExitCode::io) where it cannot be written.
class LineLog {
public:
    explicit LineLog(std::string path);
    LineLog(const LineLog&) = delete;
    LineLog& operator=(const LineLog&) = delete;
    ~LineLog();
    void add(std::string_view line);

private:
    std::string path_;
    int file_;
};

}  // namespace tvsgs
