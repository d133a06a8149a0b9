// Memory on disk.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace tvsgs {

/// A file that has no name, so that nothing of it is left however the program ends. All throw
/// Error(ExitCode::io).
class ScratchFile {
public:
    /// In `folder`, which is there; "": where the program runs. `purpose` ends messages.
    ScratchFile(const std::string& folder, std::string purpose);
    ScratchFile(const ScratchFile&) = delete;
    ScratchFile& operator=(const ScratchFile&) = delete;
    ~ScratchFile();

    /// Several threads may write to places of their own.
    void write(std::int64_t offset, const void* data, std::size_t bytes) const;
    void read(std::int64_t offset, void* data, std::size_t bytes) const;

    int descriptor() const { return file_; }
    /// With what errno says.
    [[noreturn]] void fail(const std::string& what) const;

private:
    std::string folder_, purpose_;
    int file_ = -1;
};

}  // namespace tvsgs
