#include "pipeline/run/child_process.h"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>

#include "core/error.h"

namespace tvsgs {
namespace {

Error system_error(const std::string& what) {
    return Error(ExitCode::io, what, ": ", std::strerror(errno));
}

/// Runs in the child: only calls that are safe between fork and exec.
[[noreturn]] void become(
    char* const* words, char* const* environment, int output, pid_t parent, bool own_group) {
    if (own_group) setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) _exit(127);
    dup2(open("/dev/null", O_RDONLY), 0);
    dup2(output, 1);
    dup2(output, 2);
    signal(SIGPIPE, SIG_DFL);
    execve(words[0], words, environment);
    _exit(127);
}

std::vector<char*> pointers_to(std::vector<std::string>& texts) {
    std::vector<char*> pointers;
    for (std::string& text : texts) pointers.push_back(text.data());
    pointers.push_back(nullptr);
    return pointers;
}

/// The variables of this process, with replacements.
std::vector<std::string> environment_with(const std::vector<std::string>& replaced) {
    std::vector<std::string> all = replaced;
    for (char** variable = environ; *variable; ++variable) {
        const std::string_view text = *variable;
        const std::string_view name = text.substr(0, text.find('=') + 1);
        bool kept = true;
        for (const std::string& other : replaced) kept = kept && !other.starts_with(name);
        if (kept) all.emplace_back(text);
    }
    return all;
}

}  // namespace

ChildProcess::ChildProcess(const Command& command) {
    std::vector<std::string> words = command.words,
                             environment = environment_with(command.environment);
    const std::vector<char*> argv = pointers_to(words), envp = pointers_to(environment);
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) throw system_error("cannot make a pipe for " + words[0]);
    const pid_t parent = getpid();
    pid_ = fork();
    if (pid_ == 0) become(argv.data(), envp.data(), ends[1], parent, command.own_group);
    const int error = errno;
    close(ends[1]);
    if (pid_ < 0) {
        close(ends[0]);
        errno = error;
        throw system_error("cannot start " + words[0]);
    }
    output_ = ends[0];
    fcntl(output_, F_SETFL, O_NONBLOCK);
}

ChildProcess::~ChildProcess() {
    if (output_ >= 0) close(output_);
    if (code_) return;
    kill(pid_, SIGKILL);
    while (waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
    }
}

void ChildProcess::read_lines(const std::function<void(std::string_view)>& on_line) {
    char bytes[4096];
    ssize_t count = 0;
    while (output_ >= 0) {
        count = read(output_, bytes, sizeof bytes);
        if (count < 0 && errno == EINTR) continue;
        if (count < 0 && errno == EAGAIN) return;
        if (count <= 0) break;
        for (const char c : std::string_view(bytes, std::size_t(count))) {
            if (c != '\n' && c != '\r') {
                line_ += c;
                continue;
            }
            on_line(line_);
            line_.clear();
        }
    }
    if (output_ < 0) return;
    close(output_);
    output_ = -1;
    if (!line_.empty()) on_line(line_);
}

std::optional<int> ChildProcess::exit_code() {
    int status = 0;
    if (!code_ && waitpid(pid_, &status, WNOHANG) == pid_)
        code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    return code_;
}

void ChildProcess::send(int signal) const {
    if (!code_) kill(pid_, signal);
}

std::string ending_text(int code) {
    return code > 128 ? str("ended by signal ", code - 128, " (", strsignal(code - 128), ")",
                            code == 128 + SIGKILL ? ", often out of memory" : "")
                      : str("exit code ", code);
}

void LastMessage::add(std::string_view line) {
    constexpr std::size_t kMost = 3;  // lines
    if (line.empty()) return;
    const bool of_error = !lines_.empty() && lines_.front().starts_with("error:");
    if (line.starts_with("error:") || !of_error) lines_.clear();
    if (lines_.size() < kMost) lines_.emplace_back(line);
}

std::string LastMessage::text() const {
    std::string text;
    for (const std::string& line : lines_) text += (text.empty() ? "" : "\n") + line;
    return text;
}

LineLog::LineLog(std::string path)
    : path_(std::move(path)),
      file_(open(path_.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666)) {
    if (file_ < 0) throw system_error(path_ + ": cannot write it");
}

LineLog::~LineLog() {
    close(file_);
}

void LineLog::add(std::string_view line) {
    const std::string text = str(line, "\n");
    for (std::string_view rest = text; !rest.empty();) {
        const ssize_t written = write(file_, rest.data(), rest.size());
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) throw system_error(path_ + ": writing failed");
        rest.remove_prefix(std::size_t(written));
    }
}

}  // namespace tvsgs
