// Reading of DTU cameras in the format of IDR and NeuS: cameras.npz, cameras_sphere.npz.
// [docs/method/input.md#cameras-of-idr-and-neus]
#pragma once

#include <string>
#include <vector>

#include "core/math/rigid.h"

namespace tvsgs {

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
