#include "io/files/atomic_file.h"

#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <utility>

#include "core/error.h"
#include "io/files/manifest.h"

namespace tvsgs {
namespace {

Error write_error(const std::string& path, const char* doing, const std::string& reason) {
    return Error(ExitCode::io, path, ": ", doing, " failed: ", reason);
}

// Names of the existing temporary files, for remove_temporary_files(). If all slots are taken, only
// the destructor removes a file.
constexpr int kSlots = 16;
std::atomic<const char*> temporaries[kSlots];

/// Replaces the first entry that is `from` by `to`.
void replace(const char* from, const char* to) {
    for (auto& slot : temporaries)
        if (const char* expected = from; slot.compare_exchange_strong(expected, to)) return;
}

}  // namespace

void remove_temporary_files() noexcept {
    for (auto& slot : temporaries)
        if (const char* const name = slot.exchange(nullptr)) unlink(name);
}

AtomicFile::AtomicFile(const std::string& path) : path_(path) {
    static std::atomic<int> counter{0};
    namespace fs = std::filesystem;
    std::error_code error;
    const bool direct = is_stream(path);
    if (const fs::path target = fs::canonical(path, error); !direct && !error)
        path_ = target.string();
    const fs::path folder = fs::path(path_).parent_path();
    error.clear();
    if (!folder.empty()) fs::create_directories(folder, error);
    if (error) throw write_error(path, "making its folder", error.message());
    const fs::file_status status = fs::status(path_, error);
    if (fs::is_directory(status)) throw write_error(path, "writing", "it is a folder");
    if (!direct) {
        require_replaceable(path_);
        listing_ = folder_with_manifest(path_);
        temporary_ = str(path_, ".tmp-", getpid(), "-", counter++);
        replace(nullptr, temporary_.c_str());
    }
    file_ = direct ? std::fopen(path_.c_str(), "ab") : std::fopen(temporary_.c_str(), "wb");
    if (!file_) {
        const std::string reason = std::strerror(errno);
        if (!direct) replace(temporary_.c_str(), nullptr);
        throw write_error(path, "writing", reason);
    }
}

AtomicFile::~AtomicFile() {
    if (file_) std::fclose(file_);
    if (temporary_.empty()) return;
    std::remove(temporary_.c_str());
    replace(temporary_.c_str(), nullptr);
}

void AtomicFile::write(const void* data, std::size_t bytes) {
    if (bytes > 0 && std::fwrite(data, 1, bytes, file_) != bytes)
        throw write_error(path_, "writing", std::strerror(errno));
}

void AtomicFile::flush() {
    if (std::fflush(file_) != 0 || (!temporary_.empty() && fsync(fileno(file_)) != 0))
        throw write_error(path_, "writing", std::strerror(errno));
}

void AtomicFile::commit() {
    flush();
    const bool direct = temporary_.empty();
    if (std::fclose(std::exchange(file_, nullptr)) != 0)
        throw write_error(path_, "closing", std::strerror(errno));
    if (direct) return;
    if (listing_) add_to_manifest(*listing_, path_);
    if (std::rename(temporary_.c_str(), path_.c_str()) != 0)
        throw write_error(path_, "renaming the finished file", std::strerror(errno));
    replace(temporary_.c_str(), nullptr);
    temporary_.clear();
}

bool is_stream(const std::string& path) {
    namespace fs = std::filesystem;
    std::error_code code;
    const fs::file_status status = fs::status(path, code);
    if (!fs::exists(status) || fs::is_directory(status)) return false;
    return !fs::is_regular_file(status) ||
           fs::absolute(path, code).lexically_normal().parent_path() == "/dev";
}

void write_text_file(const std::string& path, std::string_view text) {
    AtomicFile file(path);
    file.write(text);
    file.commit();
}

}  // namespace tvsgs
