#include "io/files/manifest.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <string_view>

#include "core/error.h"
#include "core/version.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

fs::path list_of(const fs::path& folder) {
    return folder / kManifestName;
}

/// Entry of a file in the list: relative path on one line.
std::string entry_of(const fs::path& folder, const fs::path& file) {
    std::error_code code;
    const fs::path whole = fs::weakly_canonical(fs::absolute(file), code),
                   outer = fs::weakly_canonical(fs::absolute(folder), code);
    std::string text = whole.lexically_relative(outer).generic_string();
    std::ranges::replace(text, '\n', '\r');
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
    // One call per line, because several commands may write to a run at the same time.
    const bool written =
        file >= 0 && write(file, text.data(), text.size()) == static_cast<ssize_t>(text.size());
    const int reason = errno;
    if (file >= 0) close(file);
    if (!written) throw Error(ExitCode::io, list, ": writing failed: ", std::strerror(reason));
}

/// True if the file begins with the signature of tvsgs.
bool has_signature(const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    std::string head(4096, '\0');
    in.read(head.data(), static_cast<std::streamsize>(head.size()));
    head.resize(static_cast<std::size_t>(in.gcount()));
    const std::string_view version(kVersion), name = version.substr(0, version.find(' ') + 1);
    for (std::size_t at = 0; (at = head.find(name, at)) != std::string::npos; at += name.size())
        if (at + name.size() < head.size() && std::isdigit(head[at + name.size()])) return true;
    return false;
}

}  // namespace

void start_manifest(const fs::path& folder) {
    write_to_list(folder, O_TRUNC, "");
}

bool has_manifest(const fs::path& folder) {
    return is_file(list_of(folder));
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
    return std::ranges::find(entries, entry_of(folder, file)) != entries.end();
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

void require_replaceable(const fs::path& file) {
    std::error_code code;
    if (!fs::is_regular_file(file, code)) return;
    const auto folder = folder_with_manifest(file);
    if (folder ? is_listed(*folder, file) : fs::is_empty(file, code) || has_signature(file)) return;
    throw Error(ExitCode::usage, file.string(),
                ": already exists and is not ours; choose another name");
}

void require_not_results_file(const fs::path& file) {
    constexpr std::string_view kFiles[] = {
        "config.json", "plan.json",     "memory.json", "log.jsonl",     "cameras.json",
        "report.json", "sky.png",       "splits.json", "exposure.json", "done.json",
        "block.json",  "manifest.json", "coarse.ply"};
    constexpr std::string_view kFolders[] = {"point_cloud", "checkpoints", "gt",
                                             "images",      "masks",       "sparse"};
    const auto has = [](const auto& names, const std::string& name) {
        return std::ranges::find(names, name) != std::end(names);
    };
    std::error_code code;
    const auto folder = folder_with_manifest(file);
    if (!folder || !fs::is_regular_file(file, code) || !is_listed(*folder, file)) return;
    const fs::path entry = entry_of(*folder, file);
    const bool deep = std::ranges::any_of(
        entry, [&](const fs::path& part) { return has(kFolders, part.string()); });
    if (deep || has(kFiles, entry.filename().string()))
        throw Error(ExitCode::usage, file.string(), ": ", folder->string(),
                    " needs this file; choose another name");
}

void create_results_folder(const fs::path& folder, const std::vector<std::string>& names) {
    std::error_code code;
    fs::create_directories(folder, code);
    if (code) throw Error(ExitCode::io, folder.string(), ": cannot make it: ", code.message());
    for (const std::string& name : names) {
        require_replaceable(folder / name);
        for (fs::recursive_directory_iterator it(folder / name, code), end; !code && it != end;
             it.increment(code))
            require_replaceable(it->path());
    }
    if (!has_manifest(folder) && !folder_with_manifest(folder)) start_manifest(folder);
}

void remove_listed_files(const fs::path& folder) {
    std::error_code code;
    std::vector<fs::path> parents;
    std::vector<std::string> entries = entries_of(folder);
    // Last: a run that is killed here must remain a run, which can start again.
    std::ranges::stable_partition(entries,
                                  [](const std::string& entry) { return entry != "config.json"; });
    for (const std::string& entry : entries) {
        const fs::path file = folder / entry;
        // Ignores paths outside the folder, in case somebody edited the list.
        if (entry.empty() || entry.starts_with("../") || entry.front() == '/') continue;
        if (!fs::is_directory(fs::symlink_status(file, code))) fs::remove(file, code);
        for (fs::path up = fs::path(entry).parent_path(); !up.empty(); up = up.parent_path())
            parents.push_back(up);
    }
    fs::remove(list_of(folder), code);
    // Deepest first. A folder that is not empty stays.
    std::ranges::sort(parents, [](const fs::path& a, const fs::path& b) {
        return a.native().size() > b.native().size();
    });
    for (const fs::path& parent : parents)
        if (fs::is_empty(folder / parent, code) && !code) fs::remove(folder / parent, code);
}

}  // namespace tvsgs
