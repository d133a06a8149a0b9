// Reading and writing of mesh files: GLB, OBJ with its material, and PLY.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "core/scene/mesh.h"
#include "io/splats/ply.h"

namespace tvsgs {

enum class MeshFormat { glb, obj, ply };
enum class TextureFormat { jpeg, png, webp };

/// Like MeshTexture, with the image as the bytes of its file; empty: none.
struct EncodedTexture {
    std::string image;
    std::vector<Vec2f> places;
    std::vector<Vec3i> faces;
};

/// Format by the extension of the name.
std::optional<MeshFormat> mesh_format(const std::string& path);

/// The files of a mesh with this name; the mesh itself is last. A textured OBJ also has a material
/// and a texture file. Their names equal the mesh's name, with '_' for characters that OBJ readers
/// do not accept, such as blanks.
std::vector<std::string> mesh_files(const std::string& path, bool textured, TextureFormat format);

/// Options of write_mesh().
struct MeshFileOptions {
    TextureFormat texture_format = TextureFormat::jpeg;
    /// Origin of the mesh's frame in the scene's frame. OBJ and PLY add it to the positions, in
    /// double. GLB stores it in asset.extras.origin, because its viewers use floats.
    Vec3d origin{};
    /// Projection of the scene's frame: a comment in PLY and OBJ, asset.extras.projection in GLB;
    /// empty: none.
    std::string projection{};
    /// GLB: write vertex normals, for programs that light the mesh. The material is unlit.
    bool normals = false;
    /// GLB: rotation of the node that turns the mesh upright (+y up) in viewers. Positions and
    /// units stay as in the scene.
    Mat3<double> upright_from_scene{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
};

/// Writes the mesh in the format of its name (PLY for other names such as /dev/stdout), with its
/// texture, or with vertex colours if the texture is empty. PLY always gets vertex colours. All
/// files are complete before the first one appears. Throws Error(ExitCode::numerical) for numbers
/// that are not finite, Error(ExitCode::io), and Error(ExitCode::usage) for a texture format that
/// the mesh format does not support.
void write_mesh(const std::string& path,
                const TriangleMesh& mesh,
                const MeshTexture& texture = {},
                const MeshFileOptions& options = {});

/// Throws Error(ExitCode::input) if a GLB of this size exceeds the format's 4 GiB even without its
/// image. Call it before making a texture.
void require_glb_room(const std::string& path,
                      std::size_t vertices,
                      std::size_t faces,
                      bool textured);

/// Throws Error(ExitCode::usage) if write_mesh() would do so for this texture format.
void require_texture_format(const std::string& path, TextureFormat format);

/// Throw Error for numbers that are not finite, sizes that differ, and indices out of range.
/// `what`: the name of the numbers in messages.
void check_mesh(const std::string& path, const TriangleMesh& mesh);
void check_finite(const std::string& path, const std::vector<Vec3f>& values, const char* what);
void check_size(const std::string& path, std::size_t found, std::size_t expected, const char* what);

/// Reads a mesh by the extension of its name: GLB (triangles), OBJ (polygons become fans), else as
/// read_ply(). A GLB of tvsgs is read in the scene's frame, another one as its nodes place it. A
/// GLB of tvsgs repeats vertices that have several texture coordinates or belong to several
/// primitives; the reader merges vertices at equal positions, in the order of the faces. Throws
/// Error(ExitCode::input).
/// `want_colors`: if false, ignores a GLB's texture, which may be damaged or too large.
/// `texture`: gets the texture of a GLB of tvsgs, if it is a readable JPEG or PNG.
PlyContents read_mesh(const std::string& path,
                      Vec3d origin = {},
                      bool want_colors = true,
                      EncodedTexture* texture = nullptr);
/// Like read_ply_geometry().
PlyGeometry read_mesh_geometry(const std::string& path);

// Parts of write_mesh() and read_mesh().

/// Encodes the image of a texture as a file.
std::string encode_texture(const ImageU8& image, TextureFormat format);

/// The bytes of a GLB. Throws Error(ExitCode::input) beyond the format's 4 GiB.
std::string glb_bytes(const std::string& path,
                      const TriangleMesh& mesh,
                      const MeshTexture& texture,
                      const MeshFileOptions& options);

/// Positions are in the frame of the file, or of the scene for files of tvsgs. Throws
/// Error(ExitCode::input).
PlyGeometry read_glb(const std::string& path,
                     std::string_view bytes,
                     bool want_colors,
                     EncodedTexture* texture = nullptr);

}  // namespace tvsgs
