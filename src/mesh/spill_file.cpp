#include "mesh/spill_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "core/error.h"

namespace tvsgs {
namespace {

[[noreturn]] void fail(const std::string& folder, const std::string& what) {
    throw Error(ExitCode::io,
                str(folder, ": ", what, ": ", std::strerror(errno),
                    "; what does not fit into --memory is kept in this folder for a while"));
}

}  // namespace

SpillFile::SpillFile(const std::string& folder) : folder_(folder.empty() ? "." : folder) {
    std::error_code code;
    std::filesystem::create_directories(folder_, code);
    std::string name = folder_ + "/.tvsgs-spill-XXXXXX";
    file_ = mkostemp(name.data(), O_CLOEXEC);
    if (file_ < 0) fail(folder_, "a temporary file cannot be made");
    unlink(name.c_str());
}

SpillFile::~SpillFile() {
    if (file_ >= 0) close(file_);
}

std::int64_t SpillFile::append_bytes(const void* data, std::size_t bytes) {
    const std::int64_t start = bytes_;
    for (const char* at = static_cast<const char*>(data); bytes > 0;) {
        const ssize_t written = pwrite(file_, at, bytes, bytes_);
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) fail(folder_, str("writing failed after ", bytes_, " bytes"));
        at += written, bytes -= static_cast<std::size_t>(written), bytes_ += written;
    }
    return start;
}

void SpillFile::read_bytes(std::int64_t offset, void* data, std::size_t bytes) const {
    for (char* at = static_cast<char*>(data); bytes > 0;) {
        const ssize_t got = pread(file_, at, bytes, offset);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) fail(folder_, "reading back failed");
        at += got, bytes -= static_cast<std::size_t>(got), offset += got;
    }
}

}  // namespace tvsgs
