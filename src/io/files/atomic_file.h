// Files that are written completely or not at all.
#pragma once

#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace tvsgs {

/// A file that appears under its name only when commit() has flushed it to disk, so no reader sees
/// an incomplete file. Follows a symbolic link. Appends directly to a stream (is_stream()). Adds
/// the file to its folder's manifest, if there is one (io/files/manifest.h). Throws
/// Error(ExitCode::usage) if a file of that name exists, is not empty and was not written by tvsgs,
/// and Error(ExitCode::io) with the path and the system's reason.
class AtomicFile {
public:
    explicit AtomicFile(const std::string& path);  // creates the parent folders
    AtomicFile(const AtomicFile&) = delete;
    AtomicFile& operator=(const AtomicFile&) = delete;
    ~AtomicFile();  // removes the temporary file unless commit() was called

    void write(const void* data, std::size_t bytes);
    void write(std::string_view text) { write(text.data(), text.size()); }
    /// Flushes the written data to the disk, so that commit() only renames.
    void flush();
    void commit();

private:
    std::string path_, temporary_;  // temporary_ is empty if path_ is written directly
    std::optional<std::filesystem::path> listing_;  // folder with the manifest
    std::FILE* file_ = nullptr;
};

/// Removes the temporary files of this process. Signal handlers that end the process may call it:
/// it calls only functions that POSIX allows in them.
void remove_temporary_files() noexcept;

/// True for a path that is not a regular file, such as a pipe or /dev/stdout.
bool is_stream(const std::string& path);

/// Writes the text as one atomic file.
void write_text_file(const std::string& path, std::string_view text);

}  // namespace tvsgs
