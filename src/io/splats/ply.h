// Reading and writing of PLY files: splats (3DGS property set), point clouds and meshes.
#pragma once

#include <string>
#include <vector>

#include "core/scene/gaussians.h"
#include "core/scene/mesh.h"
#include "core/scene/scene.h"

namespace tvsgs {

/// Contents of any PLY with x y z: ASCII or binary of either byte order, with extra properties.
/// Polygons become fans of triangles. Colours (uchar 0-255 or float 0-1), normals and confidences
/// (properties confidence or weight) are read if present. `origin`, here and below: origin of the
/// result's frame in the file's frame. Readers subtract it and writers add it, in double.
struct PlyContents {
    PointCloud points;
    std::vector<Vec3i> faces;
    bool is_splats = false;  // it has opacity, scale_* and rot_*; positions are splat centres
};
PlyContents read_ply(const std::string& path, Vec3d origin = {});

/// Positions in full precision, and faces, for measurements.
struct PlyGeometry {
    std::vector<Vec3d> positions;
    std::vector<Vec3i> faces;
    std::vector<float> opacity_logits;  // only of splats
    std::vector<Vec3f> colors;          // only of GLB and OBJ, if wanted; also from a texture
    bool is_splats = false;
};
PlyGeometry read_ply_geometry(const std::string& path);

/// Number of scales per splat in a file. Two: discs, as in 2DGS; the third scale, along the normal,
/// becomes a millionth of the larger one.
enum class PlyScales { three, two };

/// Reads only the header; three if the file has no scales. Throws Error(ExitCode::input).
PlyScales read_ply_scales(const std::string& path);

/// Reads 3DGS splats: properties by name in any order, SH degree from the number of f_rest_*. Drops
/// splats that are not finite with a warning. Applies a smoothing filter (filter_3D) to scales and
/// opacities, so that every rasteriser renders the same; Gaussians::filter is empty. `scales`
/// returns the number of scales in the file.
Gaussians<Cpu> read_splat_ply(const std::string& path,
                              Vec3d origin = {},
                              PlyScales* scales = nullptr);

/// All writers write atomic files. write_splat_ply() throws Error(ExitCode::numerical) with the
/// first value that is not finite. Positions are floats, or doubles if there is an origin to add. A
/// filter is written unchanged beside the unfiltered scales and opacities.
/// `signature`: adds a fourth line that identifies tvsgs, so that a later run may replace the file
/// without a manifest; otherwise the header is exactly that of 3DGS.
/// `projection`, if not empty, becomes a comment.
void write_splat_ply(const std::string& path,
                     const Gaussians<Cpu>& gaussians,
                     Vec3d origin = {},
                     PlyScales scales = PlyScales::three,
                     bool signature = false,
                     const std::string& projection = "");
/// Write a mesh with its colours and numbers of views, or a cloud with its attributes.
void write_mesh_ply(const std::string& path,
                    const TriangleMesh& mesh,
                    Vec3d origin = {},
                    const std::string& projection = "");
/// `columns`: further properties, behind the others.
struct PlyColumn {
    const char* name;
    const std::vector<float>& values;  // one per point
};
void write_cloud_ply(const std::string& path,
                     const PointCloud& points,
                     Vec3d origin = {},
                     const std::vector<PlyColumn>& columns = {});

}  // namespace tvsgs
