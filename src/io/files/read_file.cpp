#include "io/files/read_file.h"

#include <cerrno>
#include <cstring>

#include "core/grouped.h"

namespace tvsgs {

bool is_file(const std::filesystem::path& path) {
    std::error_code code;
    return std::filesystem::is_regular_file(path, code);
}

void require_regular_file(const std::string& path) {
    namespace fs = std::filesystem;
    std::error_code code;
    const fs::file_status status = fs::status(path, code);
    if (fs::is_directory(status)) throw input_error(path, ": is a folder; expected a file");
    if (fs::exists(status) && !fs::is_regular_file(status))
        throw input_error(path, ": is a device or a pipe; expected a regular file");
}

OpenFile open_file(const std::string& path) {
    require_regular_file(path);
    OpenFile file(std::fopen(path.c_str(), "rb"), std::fclose);
    if (!file) throw input_error(path, ": cannot open it: ", std::strerror(errno));
    return file;
}

void check_read(const OpenFile& file, const std::string& path) {
    if (std::ferror(file.get()))
        throw Error(ExitCode::io, path, ": reading failed: ", std::strerror(errno));
}

std::string read_bytes(const std::string& path, std::uintmax_t limit) {
    std::error_code no_matter;
    const OpenFile file = open_file(path);
    std::string bytes;
    const auto size = std::filesystem::file_size(path, no_matter);
    if (!no_matter && size > limit)
        throw input_error(path, ": ", grouped(size), " bytes; expected at most ", grouped(limit));
    if (!no_matter) bytes.reserve(size);
    char chunk[1 << 16];
    for (;;) {
        const std::size_t count = std::fread(chunk, 1, sizeof chunk, file.get());
        bytes.append(chunk, count);
        if (count < sizeof chunk) break;
    }
    check_read(file, path);
    return bytes;
}

void check_json_depth(int depth, const std::string& where) {
    constexpr int kMaxDepth = 64;  // our own files have six levels
    if (depth > kMaxDepth)
        throw input_error(where, ": JSON nested deeper than ", kMaxDepth, " levels");
}

std::string read_text(const std::string& path, std::uintmax_t limit) {
    std::string text = read_bytes(path, limit);
    if (text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);
    return text;
}

}  // namespace tvsgs
