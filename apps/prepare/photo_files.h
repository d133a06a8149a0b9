// The files of photographs and videos, by their names. Needs no OpenCV.
#pragma once

#include <initializer_list>
#include <string>
#include <vector>

namespace tvsgs::prepare {

/// Names of the photographs below `folder`, relative to it and sorted. Skips names that begin with
/// a dot, and warns of formats that cannot be read. Throws Error(ExitCode::input) if there are
/// fewer than two.
std::vector<std::string> photo_files(const std::string& folder);

/// Decides by the extension.
bool is_video(const std::string& file);

std::string lower_extension(const std::string& file);
bool is_one_of(const std::string& extension, std::initializer_list<const char*> known);

/// Whether a photograph with this extension is converted to PNG, because Debian's COLMAP or
/// training does not read it.
bool needs_converting(const std::string& extension);

/// Cameras of these photographs that exist already, in the folder or above it; empty: none.
std::string find_model_of(const std::string& folder);

}  // namespace tvsgs::prepare
