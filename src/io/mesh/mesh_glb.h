// glTF's binary form of a mesh; what mesh_files.h calls.
#pragma once

#include <string>
#include <string_view>

#include "io/mesh/mesh_files.h"

namespace tvsgs {

/// The picture of a texture as a file. Throws Error(ExitCode::usage) where this build cannot.
std::string encode_texture(const ImageU8& image, TextureFormat format);

/// The bytes of a GLB. Throws Error(ExitCode::input) beyond the format's 4 GiB.
std::string glb_bytes(const std::string& path,
                      const TriangleMesh& mesh,
                      const MeshTexture& texture,
                      const MeshFileOptions& options);

/// A mesh of a file: positions in double in the frame of the file, or of the scene for ours.
struct ReadMesh {
    std::vector<Vec3d> positions;
    std::vector<Vec3f> colors;  // where `want_colors`: of vertices or of the texture there
    std::vector<Vec3i> faces;
};
ReadMesh read_glb(const std::string& path, std::string_view bytes, bool want_colors);
ReadMesh read_obj(const std::string& path, std::string_view bytes, bool want_colors);

}  // namespace tvsgs
