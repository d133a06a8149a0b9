// Nameless temporary file for data that does not fit into memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace tvsgs {

/// A file without a name, so that the system deletes it however the program ends. All functions
/// throw Error(ExitCode::io).
class ScratchFile {
public:
    /// `folder` must exist; "": the current folder. Messages end with `purpose`.
    ScratchFile(const std::string& folder, std::string purpose);
    ScratchFile(const ScratchFile&) = delete;
    ScratchFile& operator=(const ScratchFile&) = delete;
    ~ScratchFile();

    /// Several threads may write to different ranges.
    void write(std::int64_t offset, const void* data, std::size_t bytes) const;
    void read(std::int64_t offset, void* data, std::size_t bytes) const;

    int descriptor() const { return file_; }
    /// Throws with the text of errno.
    [[noreturn]] void fail(const std::string& what) const;

private:
    std::string folder_, purpose_;
    int file_ = -1;
};

}  // namespace tvsgs
