// Readers of the scene layouts: cameras, images and other files of a scene's folder.
// [docs/guide/input.md#other-layouts]
#pragma once

#include <map>
#include <string>
#include <vector>

#include "io/scene/colmap.h"
#include "io/scene/scene_options.h"

namespace tvsgs {

/// Contents of a scene's folder, before photographs are read.
struct SceneLayout {
    std::string format;                        // name of the layout in scene.format
    std::string source;                        // folder or file of the cameras, for messages
    ColmapModel model;                         // images sorted by name
    std::string images;                        // folder of the image names
    std::string points;                        // PLY of initial points without tracks; may be empty
    std::map<std::string, std::string> masks;  // mask file by image name, if the layout lists masks
    std::vector<std::string> train, test;      // the layout's own split; empty: none
    bool alpha_on_black = false;  // transparent pixels become black, as in 3DGS for Blender
};

/// Detects and reads the layout of the scene's folder. Throws Error(ExitCode::input):
/// E_SCENE_LAYOUT with the list of supported layouts, or an error of the cameras.
SceneLayout read_layout(const SceneOptions& options);

// One reader per layout. read_layout() chooses between them.
SceneLayout read_npz_layout(const SceneOptions& options);
SceneLayout read_mvsnet_layout(const SceneOptions& options);
SceneLayout read_blender_layout(const SceneOptions& options);
SceneLayout read_nerfstudio_layout(const SceneOptions& options);

// Helpers of the readers.

/// Sorted names of the image files in a folder; empty if the folder does not exist.
std::vector<std::string> image_names(const std::string& folder);

/// The folder of the images: `scene.images`, else one of `standard`. Throws E_NO_IMAGES.
std::string find_image_folder(const SceneOptions& options,
                              const std::vector<std::string>& standard);

/// Adds an image with its own pinhole camera.
void add_view(SceneLayout& layout, const std::string& name, const Intrinsics& camera, Rigid3d pose);

/// The rotation nearest to `R`, for rounded matrices. Throws E_POSE_NAN, or E_POSE_ROT with `where`
/// if `R` is not a rotation within 1e-3.
Rigid3d checked_pose(const Mat3<double>& R, Vec3d t, const std::string& where);

/// A layout without views.
SceneLayout empty_layout(const char* format, const std::string& source, const std::string& images);

/// The layout with its images sorted by name. Throws E_DUPLICATE_ID if two images have the same
/// name.
SceneLayout finished(SceneLayout layout);

}  // namespace tvsgs
