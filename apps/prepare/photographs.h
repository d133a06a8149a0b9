// Finds the photographs of a new scene and copies them into it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apps/prepare/photo_files.h"
#include "io/images/exif.h"

namespace tvsgs::prepare {

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
