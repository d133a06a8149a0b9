// Finds the photographs of a new scene and copies them into it.
#pragma once

#include <initializer_list>
#include <optional>
#include <string>
#include <vector>

#include "io/images/image_file.h"

namespace tvsgs::prepare {

// The files of photographs and videos, by their names; in photo_files.cpp, which needs no OpenCV.

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

struct Photograph {
    std::string file;  // present location
    std::string name;  // in the scene: path below the folder, possibly with another extension
    int width = 0, height = 0;
    std::string camera;                  // maker, model and focal length, if the file has them
    std::optional<GeodeticPlace> place;  // of the camera, if the file has it
    bool convert = false;                // to PNG
};

/// Photographs with the same focal length and lens.
struct CameraGroup {
    std::string description;  // for messages
    std::vector<std::string> names;
};

enum class Sharing { automatic, one, each };

/// Reads the photographs of photo_files(). Throws Error(ExitCode::input), also for a file with an
/// image extension that is not an image.
std::vector<Photograph> find_photographs(const std::string& folder);

/// `one`, `each`, or automatic: one group per size and, if the files have the data, per camera and
/// focal length. Throws Error(ExitCode::input) for `one` with several sizes.
std::vector<CameraGroup> group_by_camera(const std::vector<Photograph>& photographs,
                                         Sharing sharing);

/// Copies or converts the photographs to `folder`, by their names.
void put_photographs(const std::vector<Photograph>& photographs, const std::string& folder);

}  // namespace tvsgs::prepare
