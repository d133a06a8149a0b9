// Running our commands from tests.
#pragma once

#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <ostream>
#include <sstream>
#include <string>

namespace tvsgs {

inline std::string contents(const std::filesystem::path& path) {
    std::ifstream in(path, std::ios::binary);
    std::ostringstream out;
    out << in.rdbuf();
    return out.str();
}

/// What a command did: its exit code (128 + the signal that ended it, as a shell has it), and what
/// it wrote to out.txt and err.txt.
struct Result {
    int code;
    std::string out, err;

    bool says(const std::string& text) const { return err.find(text) != std::string::npos; }
};
inline std::ostream& operator<<(std::ostream& stream, const Result& result) {
    return stream << "exit code " << result.code << ": " << result.err;
}

/// Runs a script in a folder; it redirects to out.txt and err.txt there.
inline Result run_script(const std::filesystem::path& folder, const std::string& script) {
    const int status = std::system(("cd '" + folder.string() + "' && " + script).c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status),
            contents(folder / "out.txt"), contents(folder / "err.txt")};
}

/// Runs bin/tvsgs-<tool> in a folder on `threads` threads.
inline Result run_tool(const std::filesystem::path& folder,
                       const std::string& tool,
                       const std::string& arguments,
                       int threads = 2) {
    return run_script(folder, "OMP_NUM_THREADS=" + std::to_string(threads) +
                                  " " TVSGS_BIN_DIR "/tvsgs-" + tool + " " + arguments +
                                  " >out.txt 2>err.txt");
}

}  // namespace tvsgs
