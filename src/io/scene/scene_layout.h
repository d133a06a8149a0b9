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
    std::string format;    // name of the layout in scene.format
    std::string source;    // folder or file of the cameras, for messages
    std::string images;    // folder of the image names
    ColmapModel model{};   // images sorted by name
    std::string points{};  // PLY of initial points without tracks; may be empty
    std::map<std::string, std::string> masks{};  // mask file by image name, if the layout lists any
    std::vector<std::string> train{}, test{};    // the layout's own split; empty: none
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

/// The layout with its images sorted by name. Throws E_DUPLICATE_ID if two images have the same
/// name.
SceneLayout finished(SceneLayout layout);

// DTU cameras in the format of IDR and NeuS: cameras.npz, cameras_sphere.npz.
// [docs/method/input.md#cameras-of-idr-and-neus]

/// One camera of the file.
struct NpzCamera {
    Vec3d rows[3];  // of world_mat without its last column: pixel ~ rows * world + last
    Vec3d last;
    // Decomposition of this matrix. The principal point is as in the file; skew is dropped.
    double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
    Rigid3d camera_from_world;
};

/// All cameras of the file.
struct NpzCameras {
    std::vector<NpzCamera> views;  // world_mat_0, world_mat_1, ...
    // scale_mat: world (mm) = scale * normalised + offset; 1 and 0 if the file has none
    double scale = 1;
    Vec3d offset{};
};

/// Throws Error(ExitCode::input): E_NPZ_CAMERAS if a matrix is missing, not 4x4, not finite or
/// singular; E_SCALE_MAT if scale_mat is not a uniform scale with a shift, or differs between
/// views.
NpzCameras read_npz_cameras(const std::string& path);

}  // namespace tvsgs
