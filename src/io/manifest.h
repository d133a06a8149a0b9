// Which files of a folder are ours: a run's, or a made scene's. What is not in the list is the
// user's, and is neither replaced nor removed.
#pragma once

#include <filesystem>
#include <optional>

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

/// Removes the files of the list, the list, and folders that are empty then.
void remove_listed_files(const std::filesystem::path& folder);

}  // namespace tvsgs
