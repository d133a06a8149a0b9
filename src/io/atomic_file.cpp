#include "io/atomic_file.h"

#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>

#include "core/error.h"

namespace tvsgs {
namespace {

Error write_error(const std::string& path, const char* doing, const std::string& reason) {
    return Error(ExitCode::io, str(path, ": ", doing, " failed: ", reason));
}

}  // namespace

AtomicFile::AtomicFile(const std::string& path) : path_(path) {
    static std::atomic<int> counter{0};
    const std::filesystem::path folder = std::filesystem::path(path).parent_path();
    std::error_code error;
    if (!folder.empty()) std::filesystem::create_directories(folder, error);
    if (error) throw write_error(path, "making its folder", error.message());
    if (std::filesystem::is_directory(path, error))
        throw write_error(path, "writing", "it is a folder");
    temporary_ = str(path, ".tmp-", getpid(), "-", counter++);
    file_ = std::fopen(temporary_.c_str(), "wb");
    if (!file_) throw write_error(path, "writing", std::strerror(errno));
}

AtomicFile::~AtomicFile() {
    if (file_) std::fclose(file_);
    if (!temporary_.empty()) std::remove(temporary_.c_str());
}

void AtomicFile::write(const void* data, std::size_t bytes) {
    if (bytes > 0 && std::fwrite(data, 1, bytes, file_) != bytes)
        throw write_error(path_, "writing", std::strerror(errno));
}

void AtomicFile::commit() {
    if (std::fflush(file_) != 0 || fsync(fileno(file_)) != 0)
        throw write_error(path_, "writing", std::strerror(errno));
    if (std::fclose(std::exchange(file_, nullptr)) != 0)
        throw write_error(path_, "closing", std::strerror(errno));
    if (std::rename(temporary_.c_str(), path_.c_str()) != 0)
        throw write_error(path_, "renaming the finished file", std::strerror(errno));
    temporary_.clear();
}

void write_text_file(const std::string& path, std::string_view text) {
    AtomicFile file(path);
    file.write(text);
    file.commit();
}

}  // namespace tvsgs
