// The photographs of a scene to be: found in a folder, and put where COLMAP and training read them.
#pragma once

#include <string>
#include <vector>

namespace tvsgs::prepare {

struct Photograph {
    std::string file;  // where it lies now
    std::string name;  // in the scene: its path below the folder, maybe with another extension
    int width = 0, height = 0;
    std::string camera;    // maker, model and focal length, where the file says them
    bool convert = false;  // into a PNG
};

/// Photographs that share focal length and lens.
struct CameraGroup {
    std::string description;  // for messages
    std::vector<std::string> names;
};

enum class Sharing { automatic, one, each };

/// All of them below `folder`, sorted by name. Throws Error(ExitCode::input) where there are fewer
/// than two, and for a file that looks like a photograph and is none, by its name.
std::vector<Photograph> find_photographs(const std::string& folder);

/// By its extension.
bool is_video(const std::string& file);

/// `one`, `each`, or automatic: of one size and, where the files say so, from one camera at one
/// focal length. Throws Error(ExitCode::input) for `one` of several sizes.
std::vector<CameraGroup> group_by_camera(const std::vector<Photograph>& photographs,
                                         Sharing sharing);

/// Copies, or converts, them below `folder`, by their names.
void put_photographs(const std::vector<Photograph>& photographs, const std::string& folder);

/// Where a model of these photographs is already; empty: nowhere near.
std::string find_model_of(const std::string& folder);

}  // namespace tvsgs::prepare
