// What the layouts of scenes have in common: cameras, images and where the rest lies.
// [docs/guide/input.md#other-layouts]
#pragma once

#include <map>
#include <string>
#include <vector>

#include "io/scene/colmap.h"
#include "io/scene/scene_options.h"

namespace tvsgs {

struct SceneLayout {
    std::string format;  // as scene.format names it
    std::string source;  // the folder or file of the cameras, for messages
    ColmapModel model;   // images sorted by name
    std::string images;  // folder that the names refer to
    std::string points;  // PLY of initial points that does not say who saw them; may be empty
    std::map<std::string, std::string> masks;  // files by image name, where the layout names them
    std::vector<std::string> train, test;      // the layout's own split; empty: none
    bool alpha_on_black = false;  // transparent pixels become black, as 3DGS does for Blender
};

/// Finds and reads the layout in the folder of the scene. Throws Error(ExitCode::input):
/// E_SCENE_LAYOUT with all that was looked for, or what is wrong with the cameras.
SceneLayout read_layout(const SceneOptions& options);

// One reader per layout; read_layout chooses.
SceneLayout read_npz_layout(const SceneOptions& options);
SceneLayout read_mvsnet_layout(const SceneOptions& options);
SceneLayout read_blender_layout(const SceneOptions& options);
SceneLayout read_nerfstudio_layout(const SceneOptions& options);

// What they share.

/// Names of the image files in a folder, sorted; none where there is no such folder.
std::vector<std::string> image_names(const std::string& folder);

/// The folder of the images: `scene.images`, else one of `standard`. Throws E_NO_IMAGES.
std::string find_image_folder(const SceneOptions& options,
                              const std::vector<std::string>& standard);

/// Adds an image with a pinhole camera of its own.
void add_view(SceneLayout& layout, const std::string& name, const Intrinsics& camera, Rigid3d pose);

/// The rotation next to `R`, for matrices that were rounded. Throws E_POSE_NAN or E_POSE_ROT, with
/// `where`, for what is none within 1e-3.
Rigid3d checked_pose(const Mat3<double>& R, Vec3d t, const std::string& where);

/// A layout without views.
SceneLayout empty_layout(const char* format, const std::string& source, const std::string& images);

/// The same with its images sorted by name; throws E_DUPLICATE_ID where two share one.
SceneLayout finished(SceneLayout layout);

}  // namespace tvsgs
