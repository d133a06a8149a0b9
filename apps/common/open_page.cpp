#include "apps/common/open_page.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>

#include <chrono>
#include <cstring>
#include <filesystem>
#include <thread>

#include "core/error.h"
#include "core/log.h"

extern char** environ;

namespace tvsgs {
namespace {

constexpr const char* kOpener = "xdg-open";
constexpr int kPolls = 20;
constexpr std::chrono::milliseconds kPoll{100};

/// Starts the opener in a session of its own, so that Ctrl-C here does not close the browser.
/// Returns an error number.
int start(const std::string& page, pid_t& child) {
    posix_spawn_file_actions_t files;
    posix_spawnattr_t attributes;
    posix_spawn_file_actions_init(&files);
    posix_spawnattr_init(&attributes);
    for (const int stream : {0, 1, 2})
        posix_spawn_file_actions_addopen(&files, stream, "/dev/null", O_RDWR, 0);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID);
    std::string name = kOpener, argument = std::filesystem::absolute(page);  // no flag
    char* const words[] = {name.data(), argument.data(), nullptr};
    const int error = posix_spawnp(&child, kOpener, &files, &attributes, words, environ);
    posix_spawn_file_actions_destroy(&files);
    posix_spawnattr_destroy(&attributes);
    return error;
}

}  // namespace

void open_page(const std::string& page) {
    pid_t child = 0;
    if (const int error = start(page, child); error != 0)
        return spdlog::warn("{}: {}; open {} in a browser", kOpener, std::strerror(error), page);
    int status = 0;
    for (int poll = 0; poll < kPolls; ++poll, std::this_thread::sleep_for(kPoll)) {
        if (waitpid(child, &status, WNOHANG) != child) continue;
        if (status != 0)
            spdlog::warn("{} found no browser (exit code {}); open {} yourself", kOpener,
                         WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), page);
        return;
    }
}

}  // namespace tvsgs
