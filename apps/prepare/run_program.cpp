#include "apps/prepare/run_program.h"

#include <poll.h>
#include <unistd.h>

#include <cstdlib>
#include <deque>
#include <fstream>
#include <sstream>

#include "core/error.h"
#include "pipeline/run/child_process.h"
#include "pipeline/run/signals.h"

namespace tvsgs::prepare {

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
    LineLog file(log);
    std::string shown = "\n$";
    for (const std::string& word : command) shown += " " + word;
    file.add(shown);
    ChildProcess child({command, {"QT_QPA_PLATFORM=offscreen", "TERM=dumb"}});  // no colours
    for (;;) {
        SignalGuard::check();
        pollfd wanted{child.output(), POLLIN, 0};
        // ms: a signal may arrive between check and poll; without output the program is ending.
        poll(&wanted, 1, child.output() < 0 ? 5 : 200);
        const std::optional<int> code = child.exit_code();
        child.read_lines([&](std::string_view line) {
            file.add(line);
            on_line(line);
        });
        on_line({});
        if (!code) continue;
        SignalGuard::check();  // the program may have received the same signal
        return *code;
    }
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
