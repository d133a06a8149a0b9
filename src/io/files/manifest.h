// Manifests: lists of the files that tvsgs wrote. Folders of results keep one; a file elsewhere
// carries a signature (core/version.h). tvsgs never replaces or removes other files.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace tvsgs {

inline constexpr const char* kManifestName = ".tvsgs-files";

/// Creates an empty list in the folder. Throws Error(ExitCode::io).
void start_manifest(const std::filesystem::path& folder);

/// The nearest parent folder of `file` that has a list.
std::optional<std::filesystem::path> folder_with_manifest(const std::filesystem::path& file);

bool has_manifest(const std::filesystem::path& folder);

/// True if the list of `folder` contains `file`, which lies below `folder`.
bool is_listed(const std::filesystem::path& folder, const std::filesystem::path& file);

/// True if any file of the list exists and is not empty.
bool holds_listed_files(const std::filesystem::path& folder);

/// Adds the file unless the list contains it. Throws Error(ExitCode::io).
void add_to_manifest(const std::filesystem::path& folder, const std::filesystem::path& file);

/// Creates a folder of results, and a list in it unless the folder or a parent has one. `names`:
/// files and folders that will be written there. Throws Error(ExitCode::usage) if one of them
/// exists and tvsgs did not write it.
void create_results_folder(const std::filesystem::path& folder,
                           const std::vector<std::string>& names);

/// Throws Error(ExitCode::usage) if `file` exists, is not empty and was not written by tvsgs.
void require_replaceable(const std::filesystem::path& file);

/// Throws Error(ExitCode::usage) if the user named, as an output, a file that a folder of results
/// needs: a configuration, a log, splats, a checkpoint, or a file of a scene.
void require_not_results_file(const std::filesystem::path& file);

/// Removes the files of the list (config.json last), the list, and the folders that are empty then.
void remove_listed_files(const std::filesystem::path& folder);

}  // namespace tvsgs
