#include "comm/rendezvous.h"

#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>

namespace tvsgs {
namespace fs = std::filesystem;

void publish(const std::string& file, const std::string& text) {
    const std::string half = str(file, ".tmp-", ::getpid());
    {
        std::ofstream out(half, std::ios::binary);
        out << text;
        out.flush();
        if (!out)
            throw Error(ExitCode::io,
                        str(file,
                            ": cannot be written, and the other processes look for this one "
                            "there; name another file with --set comm.rendezvous=FILE"));
    }
    std::error_code code;
    fs::rename(half, file, code);
    if (code) throw Error(ExitCode::io, str(file, ": ", code.message()));
}

std::string await_text(const std::string& file,
                       std::size_t bytes,
                       const std::function<void(double)>& keep_waiting) {
    using Clock = std::chrono::steady_clock;
    const Clock::time_point begin = Clock::now();
    for (;;) {
        std::ifstream in(file, std::ios::binary);
        const std::string text{std::istreambuf_iterator<char>(in), {}};
        if (text.size() == bytes) return text;
        keep_waiting(std::chrono::duration<double>(Clock::now() - begin).count());
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
}

std::string rendezvous_file(const Launch& launch, const CommOptions& options) {
    if (!options.rendezvous.empty()) return options.rendezvous;
    // Nothing else is certain to be alike: parents and sessions differ where a wrapper starts each.
    if (launch.job.empty())
        throw Error(ExitCode::usage,
                    str(launch.launcher,
                        " names no job by which processes find each other; expected a file that "
                        "all of them see, the same for all, and new for each start: "
                        "--set comm.rendezvous=FILE"));
    std::error_code code;
    const fs::path folder = fs::temp_directory_path(code);
    return (folder / str("tvsgs_", ::getuid(), "_", printable("job_" + launch.job))).string();
}

}  // namespace tvsgs
