// Files that are written completely or not at all.
#pragma once

#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace tvsgs {

/// A file that appears under its name only when commit() has flushed it to disk, so no reader sees
/// an incomplete file. Follows a link. Writes directly to a stream (is_stream()), after its present
/// content. Adds the file to the manifest of its folder, if any (io/files/manifest.h). Throws
/// Error(ExitCode::usage) if a file of that name exists that tvsgs did not write, and
/// Error(ExitCode::io) with the path and the system's reason.
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

/// Removes the temporary files of this process. For signal handlers that end the process: calls
/// only functions that POSIX allows there.
void remove_temporary_files() noexcept;

/// True for a path that is not a regular file, such as a pipe or /dev/stdout.
bool is_stream(const std::string& path);

/// Writes the text as one atomic file.
void write_text_file(const std::string& path, std::string_view text);

}  // namespace tvsgs
