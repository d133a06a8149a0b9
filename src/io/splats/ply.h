// PLY files: splats (3DGS property set), point clouds and meshes.
#pragma once

#include <string>
#include <vector>

#include "core/scene/gaussians.h"
#include "core/scene/mesh.h"
#include "core/scene/scene.h"

namespace tvsgs {

/// Any PLY with x y z: ASCII or binary of either byte order, extra properties skipped. Faces, if
/// any, are triangulated as fans. Colours (uchar 0-255 or float 0-1), normals and confidences
/// (properties confidence or weight) are read where present. `origin`, here and below: where the
/// frame of the result lies in that of the file; taken off, and added by writers, in double.
struct PlyContents {
    PointCloud points;
    std::vector<Vec3i> faces;
    bool is_splats = false;  // it holds opacity, scale_* and rot_*: positions are splat centres
};
PlyContents read_ply(const std::string& path, Vec3d origin = {});

/// Positions in full precision and faces, for measuring.
struct PlyGeometry {
    std::vector<Vec3d> positions;
    std::vector<Vec3i> faces;
    std::vector<float> opacity_logits;  // of splats only
    bool is_splats = false;
};
PlyGeometry read_ply_geometry(const std::string& path);

/// Scales of a splat in a file. Two are those of a disc, as 2DGS writes them; its third, along the
/// normal, is read as a millionth of the larger.
enum class PlyScales { three, two };

/// 3DGS splats, properties by name in any order, SH degree from the number of f_rest_*. Non-finite
/// splats are dropped with a warning. A smoothing filter (filter_3D) goes into scales and
/// opacities, so that every rasteriser draws the same; Gaussians::filter is empty. `scales`: what
/// the file has.
Gaussians<Cpu> read_splat_ply(const std::string& path,
                              Vec3d origin = {},
                              PlyScales* scales = nullptr);

/// Writers go through a temporary file, flushed and renamed. write_splat_ply throws
/// Error(ExitCode::numerical) naming the first non-finite value instead of writing it. Positions
/// are floats, or doubles where there is an origin to add. A filter is written as it is, beside
/// the scales and opacities that it has not touched. `signature`: its fourth line says who wrote
/// it, so that it may be replaced where no list of our files is; else it is exactly that of 3DGS.
void write_splat_ply(const std::string& path,
                     const Gaussians<Cpu>& gaussians,
                     Vec3d origin = {},
                     PlyScales scales = PlyScales::three,
                     bool signature = false);
void write_mesh_ply(const std::string& path, const TriangleMesh& mesh, Vec3d origin = {});
void write_cloud_ply(const std::string& path, const PointCloud& points, Vec3d origin = {});

}  // namespace tvsgs
