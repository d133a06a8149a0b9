#pragma once

#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace tvsgs {

/// A file that appears under its name only when commit() has flushed it to disk: a reader never
/// sees half of it. A link is followed; to a stream (is_stream()) it is written directly, behind
/// what is there. In a folder that keeps a list of its files (io/files/manifest.h) it is added to
/// that. Throws Error(ExitCode::usage) when a file of that name is there and not ours,
/// Error(ExitCode::io) with the path and the system's reason.
class AtomicFile {
public:
    explicit AtomicFile(const std::string& path);  // creates the parent folders
    AtomicFile(const AtomicFile&) = delete;
    AtomicFile& operator=(const AtomicFile&) = delete;
    ~AtomicFile();  // without commit(): the temporary file is removed

    void write(const void* data, std::size_t bytes);
    void write(std::string_view text) { write(text.data(), text.size()); }
    /// What has been written is on the disk: commit() then only renames.
    void flush();
    void commit();

private:
    std::string path_, temporary_;  // temporary_ is empty where path_ is written directly
    std::optional<std::filesystem::path> listing_;  // the folder that keeps a list
    std::FILE* file_ = nullptr;
};

/// Removes the temporary files of this process. For signal handlers that end it: calls only what
/// POSIX allows there.
void remove_temporary_files() noexcept;

/// What is no file, as a pipe, and what a name in /dev leads to, as /dev/stdout.
bool is_stream(const std::string& path);

/// The whole text in one go.
void write_text_file(const std::string& path, std::string_view text);

}  // namespace tvsgs
