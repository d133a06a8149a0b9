#include "apps/prepare/run_program.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <fstream>
#include <sstream>

#include "core/error.h"
#include "pipeline/signals.h"

namespace tvsgs::prepare {
namespace {

/// A descriptor that is closed at the end.
struct Descriptor {
    int number = -1;
    Descriptor() = default;
    explicit Descriptor(int n) : number(n) {}
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;
    ~Descriptor() { close_now(); }
    void close_now() {
        if (number >= 0) close(number);
        number = -1;
    }
};

Error system_error(const std::string& what) {
    return Error(ExitCode::io, str(what, ": ", std::strerror(errno)));
}

/// In the child: only calls that are safe between fork and exec.
[[noreturn]] void become(char* const* words, char* const* environment, int output, pid_t parent) {
    prctl(PR_SET_PDEATHSIG, SIGTERM);  // it must not outlive us
    if (getppid() != parent) _exit(127);
    const int nothing = open("/dev/null", O_RDONLY);
    dup2(nothing, 0);
    dup2(output, 1);
    dup2(output, 2);
    signal(SIGPIPE, SIG_DFL);
    execve(words[0], words, environment);
    _exit(127);
}

void write_all(int descriptor, std::string_view bytes, const std::string& path) {
    while (!bytes.empty()) {
        const ssize_t written = write(descriptor, bytes.data(), bytes.size());
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) throw system_error(path + ": writing failed");
        bytes.remove_prefix(static_cast<std::size_t>(written));
    }
}

/// A program that runs; it is ended and waited for where an exception passes.
class Child {
public:
    explicit Child(pid_t pid) : pid_(pid) {}
    Child(const Child&) = delete;
    Child& operator=(const Child&) = delete;
    ~Child() {
        if (pid_ <= 0) return;
        kill(pid_, SIGKILL);
        wait();
    }
    int wait() {
        int status = 0;
        while (waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
        }
        pid_ = 0;
        return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }

private:
    pid_t pid_;
};

std::vector<char*> pointers_to(std::vector<std::string>& texts) {
    std::vector<char*> pointers;
    for (std::string& text : texts) pointers.push_back(text.data());
    pointers.push_back(nullptr);
    return pointers;
}

}  // namespace

std::string find_program(const std::string& name) {
    if (name.find('/') != std::string::npos) return access(name.c_str(), X_OK) == 0 ? name : "";
    const char* const path = std::getenv("PATH");
    std::istringstream folders(path ? path : "/usr/bin:/bin");
    for (std::string folder; std::getline(folders, folder, ':');) {
        const std::string file = (folder.empty() ? "." : folder) + "/" + name;
        if (access(file.c_str(), X_OK) == 0) return file;
    }
    return "";
}

int run_program(const std::vector<std::string>& command,
                const std::string& log,
                const std::function<void(std::string_view)>& on_line) {
    const Descriptor file(open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666));
    if (file.number < 0) throw system_error(log + ": cannot be written");
    std::string shown = "\n$";
    for (const std::string& word : command) shown += " " + word;
    write_all(file.number, shown + "\n", log);

    std::vector<std::string> words = command, environment;
    for (char** variable = environ; *variable; ++variable)
        if (!std::string_view(*variable).starts_with("QT_QPA_PLATFORM="))
            environment.push_back(*variable);
    environment.push_back("QT_QPA_PLATFORM=offscreen");
    const std::vector<char*> argv = pointers_to(words), envp = pointers_to(environment);
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) throw system_error("no pipe");
    Descriptor reading(ends[0]), writing(ends[1]);
    const pid_t parent = getpid(), pid = fork();
    if (pid < 0) throw system_error("no process for " + command[0]);
    if (pid == 0) become(argv.data(), envp.data(), writing.number, parent);
    Child child(pid);
    writing.close_now();

    std::string line;
    for (;;) {
        SignalGuard::check();
        pollfd wanted{reading.number, POLLIN, 0};
        const int ready = poll(&wanted, 1, 200);  // ms: a signal may come between check and poll
        if (ready <= 0) continue;
        char bytes[4096];
        const ssize_t count = read(reading.number, bytes, sizeof bytes);
        if (count < 0 && errno == EINTR) continue;
        if (count <= 0) break;
        const std::string_view text(bytes, static_cast<std::size_t>(count));
        write_all(file.number, text, log);
        for (const char c : text) {
            if (c != '\n' && c != '\r') {
                line += c;
            } else {
                on_line(line);
                line.clear();
            }
        }
    }
    if (!line.empty()) on_line(line);
    const int code = child.wait();
    SignalGuard::check();  // it may have ended by the same one
    return code;
}

std::string last_lines(const std::string& file, int count) {
    std::ifstream in(file);
    std::deque<std::string> lines;
    for (std::string line; std::getline(in, line);) {
        if (line.find_first_not_of(" \t=") == std::string::npos) continue;
        lines.push_back(line);
        if (lines.size() > static_cast<std::size_t>(count)) lines.pop_front();
    }
    std::string out;
    for (const std::string& line : lines) out += "\n  " + line;
    return out;
}

}  // namespace tvsgs::prepare
