#include "io/manifest.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>
#include <vector>

#include "core/error.h"
#include "io/read_file.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

fs::path list_of(const fs::path& folder) {
    return folder / kManifestName;
}

/// As it stands in the list: relative, one line.
std::string entry_of(const fs::path& folder, const fs::path& file) {
    std::error_code code;
    const fs::path whole = fs::weakly_canonical(fs::absolute(file), code),
                   outer = fs::weakly_canonical(fs::absolute(folder), code);
    std::string text = whole.lexically_relative(outer).generic_string();
    std::replace(text.begin(), text.end(), '\n', '\r');
    return text;
}

std::vector<std::string> entries_of(const fs::path& folder) {
    std::vector<std::string> entries;
    const std::string text = read_bytes(list_of(folder).string());
    for (std::size_t begin = 0, end; (end = text.find('\n', begin)) != std::string::npos;
         begin = end + 1)
        entries.push_back(text.substr(begin, end - begin));
    return entries;
}

void write_to_list(const fs::path& folder, int flags, const std::string& text) {
    const std::string list = list_of(folder).string();
    const int file = open(list.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | flags, 0666);
    // One call a line: several commands may write into a run at a time.
    const bool written =
        file >= 0 && write(file, text.data(), text.size()) == static_cast<ssize_t>(text.size());
    const int reason = errno;
    if (file >= 0) close(file);
    if (!written) throw Error(ExitCode::io, str(list, ": writing failed: ", std::strerror(reason)));
}

}  // namespace

void start_manifest(const fs::path& folder) {
    write_to_list(folder, O_TRUNC, "");
}

bool has_manifest(const fs::path& folder) {
    std::error_code code;
    return fs::is_regular_file(list_of(folder), code);
}

std::optional<fs::path> folder_with_manifest(const fs::path& file) {
    std::error_code code;
    fs::path folder = fs::weakly_canonical(fs::absolute(file), code).parent_path();
    for (;; folder = folder.parent_path()) {
        if (has_manifest(folder)) return folder;
        if (folder == folder.parent_path()) return std::nullopt;
    }
}

bool is_listed(const fs::path& folder, const fs::path& file) {
    const std::vector<std::string> entries = entries_of(folder);
    return std::find(entries.begin(), entries.end(), entry_of(folder, file)) != entries.end();
}

bool holds_listed_files(const fs::path& folder) {
    std::error_code code;
    for (const std::string& entry : entries_of(folder))
        if (fs::is_regular_file(folder / entry, code) && !fs::is_empty(folder / entry, code))
            return true;
    return false;
}

void add_to_manifest(const fs::path& folder, const fs::path& file) {
    if (!is_listed(folder, file)) write_to_list(folder, O_APPEND, entry_of(folder, file) + "\n");
}

void remove_listed_files(const fs::path& folder) {
    std::error_code code;
    std::vector<fs::path> parents;
    for (const std::string& entry : entries_of(folder)) {
        const fs::path file = folder / entry;
        // A list that somebody has changed must not lead out of the folder.
        if (entry.empty() || entry.starts_with("../") || entry.front() == '/') continue;
        if (!fs::is_directory(fs::symlink_status(file, code))) fs::remove(file, code);
        for (fs::path up = fs::path(entry).parent_path(); !up.empty(); up = up.parent_path())
            parents.push_back(up);
    }
    fs::remove(list_of(folder), code);
    // The deepest first; one that is not empty stays.
    std::sort(parents.begin(), parents.end(), [](const fs::path& a, const fs::path& b) {
        return a.native().size() > b.native().size();
    });
    for (const fs::path& parent : parents)
        if (fs::is_empty(folder / parent, code) && !code) fs::remove(folder / parent, code);
}

}  // namespace tvsgs
