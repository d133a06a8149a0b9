// Files of meshes: glTF's binary form, Wavefront's OBJ with its material, PLY; and whichever of
// them is to be measured.
#pragma once

#include <optional>
#include <string>

#include "core/scene/mesh.h"
#include "io/splats/ply.h"

namespace tvsgs {

enum class MeshFormat { glb, obj, ply };
enum class TextureFormat { jpeg, png, webp };

/// By the end of the name.
std::optional<MeshFormat> mesh_format(const std::string& path);

/// The files that a mesh of that name consists of, itself last: an OBJ with a texture has a
/// material and a picture beside it, whose names are its own without what OBJ readers stumble over,
/// as blanks.
std::vector<std::string> mesh_files(const std::string& path, bool textured, TextureFormat format);

struct MeshFileOptions {
    TextureFormat texture_format = TextureFormat::jpeg;
    /// Of the frame of the mesh in that of the scene; OBJ and PLY add it, in double, a GLB says it
    /// (asset.extras.origin), as what draws it has floats only.
    Vec3d origin{};
    /// GLB: of its vertices, for programs that light what they show; the material is unlit.
    bool normals = false;
    /// GLB: the turn of its node, so that the mesh stands upright, +y up, where it is shown; its
    /// numbers stay those of the scene, and so do its units.
    Mat3<double> upright_from_scene{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
};

/// Writes the mesh in the format of its name (other names, as /dev/stdout: PLY) with its texture,
/// or with the colours of its vertices where that is empty; PLY always has the latter. All files of
/// it are complete before the first gets its name. Throws Error(ExitCode::numerical) for numbers
/// that are not finite, Error(ExitCode::io), Error(ExitCode::usage) for a format of the texture
/// that this build or the file has not.
void write_mesh(const std::string& path,
                const TriangleMesh& mesh,
                const MeshTexture& texture = {},
                const MeshFileOptions& options = {});

/// Throws Error(ExitCode::input) where a GLB of so much is beyond the format's 4 GiB, whatever its
/// picture: to be said before a texture is made.
void require_glb_room(const std::string& path,
                      std::size_t vertices,
                      std::size_t faces,
                      bool textured);

/// Throws Error(ExitCode::usage) where write_mesh would for that texture.
void require_texture_format(const std::string& path, TextureFormat format);

/// Throws Error: what is not finite, and indices out of range.
void check_mesh(const std::string& path, const TriangleMesh& mesh);

/// By the end of the name: a GLB (triangles; where it is ours, in the frame of the scene, else as
/// its nodes place it), an OBJ (polygons as fans), else as read_ply. Vertices that a GLB of ours
/// has more than once, as their places in the texture differ or 16-bit indices do not reach them,
/// are one again: those at the same place are one, in the order of the faces. Throws
/// Error(ExitCode::input).
/// `want_colors`: else a GLB's picture, which may be damaged or too large, is not looked at.
PlyContents read_mesh(const std::string& path, Vec3d origin = {}, bool want_colors = true);
/// As read_ply_geometry.
PlyGeometry read_mesh_geometry(const std::string& path);

}  // namespace tvsgs
