// Implementation of the mesh formats behind mesh_files.h: GLB bytes, GLB and OBJ readers.
#pragma once

#include <string>
#include <string_view>

#include "io/mesh/mesh_files.h"

namespace tvsgs {

/// Encodes the image of a texture as a file.
std::string encode_texture(const ImageU8& image, TextureFormat format);

/// The bytes of a GLB. Throws Error(ExitCode::input) beyond the format's 4 GiB.
std::string glb_bytes(const std::string& path,
                      const TriangleMesh& mesh,
                      const MeshTexture& texture,
                      const MeshFileOptions& options);

/// A mesh read from a file. Positions are in double, in the frame of the file, or of the scene for
/// files of tvsgs.
struct ReadMesh {
    std::vector<Vec3d> positions;
    std::vector<Vec3f> colors;  // of the vertices, or from the texture; empty unless wanted
    std::vector<Vec3i> faces;
};
/// Readers of the two formats. Throw Error(ExitCode::input).
ReadMesh read_glb(const std::string& path, std::string_view bytes, bool want_colors);
ReadMesh read_obj(const std::string& path, std::string_view bytes, bool want_colors);

}  // namespace tvsgs
