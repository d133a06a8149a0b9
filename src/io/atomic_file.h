#pragma once

#include <cstdio>
#include <string>
#include <string_view>

namespace tvsgs {

/// A file that appears under its name only when commit() has flushed it to disk: a reader never
/// sees half of it. Throws Error(ExitCode::io) with the path and the system's reason.
class AtomicFile {
public:
    explicit AtomicFile(const std::string& path);  // creates the parent folders
    AtomicFile(const AtomicFile&) = delete;
    AtomicFile& operator=(const AtomicFile&) = delete;
    ~AtomicFile();  // without commit(): the temporary file is removed

    void write(const void* data, std::size_t bytes);
    void write(std::string_view text) { write(text.data(), text.size()); }
    void commit();

private:
    std::string path_, temporary_;
    std::FILE* file_ = nullptr;
};

/// The whole text in one go.
void write_text_file(const std::string& path, std::string_view text);

}  // namespace tvsgs
