// Which files are ours. A run, a made scene and other folders of results keep a list of them; a
// file elsewhere says so itself (core/version.h). What is not ours is neither replaced nor removed.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace tvsgs {

inline constexpr const char* kManifestName = ".tvsgs-files";

/// Begins an empty list in that folder. Throws Error(ExitCode::io).
void start_manifest(const std::filesystem::path& folder);

/// The nearest folder above `file` that has a list.
std::optional<std::filesystem::path> folder_with_manifest(const std::filesystem::path& file);

bool has_manifest(const std::filesystem::path& folder);

/// Whether `file`, below `folder`, is in its list.
bool is_listed(const std::filesystem::path& folder, const std::filesystem::path& file);

/// Whether a file of the list is there that is not empty.
bool holds_listed_files(const std::filesystem::path& folder);

/// Adds it, unless it is there. Throws Error(ExitCode::io).
void add_to_manifest(const std::filesystem::path& folder, const std::filesystem::path& file);

/// Begins a list in a folder of results, unless it, or one above it, has one; creates the folder.
/// Throws Error(ExitCode::usage) when one of `names`, files or folders with files that we are going
/// to write there, is there and not ours.
void list_results(const std::filesystem::path& folder, const std::vector<std::string>& names);

/// Throws Error(ExitCode::usage) when `file` is there, is not empty and is not ours.
void require_replaceable(const std::filesystem::path& file);

/// Throws Error(ExitCode::usage) when `file`, which a user has named for something new, is what a
/// folder of results is read by: a configuration, a log, splats, checkpoints, a scene's files.
void require_no_record(const std::filesystem::path& file);

/// Removes the files of the list, the list, and folders that are empty then.
void remove_listed_files(const std::filesystem::path& folder);

}  // namespace tvsgs
