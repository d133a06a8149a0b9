#include "core/scratch_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "core/error.h"

namespace tvsgs {

ScratchFile::ScratchFile(const std::string& folder, std::string purpose)
    : folder_(folder.empty() ? "." : folder), purpose_(std::move(purpose)) {
    std::string name = folder_ + "/.tvsgs-scratch-XXXXXX";
    file_ = mkostemp(name.data(), O_CLOEXEC);
    if (file_ < 0) fail("cannot make a temporary file");
    unlink(name.c_str());
}

ScratchFile::~ScratchFile() {
    if (file_ >= 0) close(file_);
}

void ScratchFile::write(std::int64_t offset, const void* data, std::size_t bytes) const {
    for (const char* at = static_cast<const char*>(data); bytes > 0;) {
        const ssize_t written = pwrite(file_, at, bytes, offset);
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) fail(str("writing failed after ", offset, " bytes"));
        at += written, bytes -= static_cast<std::size_t>(written), offset += written;
    }
}

void ScratchFile::read(std::int64_t offset, void* data, std::size_t bytes) const {
    for (char* at = static_cast<char*>(data); bytes > 0;) {
        const ssize_t got = pread(file_, at, bytes, offset);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) fail("reading back failed");
        at += got, bytes -= static_cast<std::size_t>(got), offset += got;
    }
}

void ScratchFile::fail(const std::string& what) const {
    throw Error(ExitCode::io, folder_, ": ", what, ": ", std::strerror(errno), "; ", purpose_);
}

}  // namespace tvsgs
