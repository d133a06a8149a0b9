// Implementation of the mesh formats behind mesh_files.h: the bytes and the reader of GLB.
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

/// Positions are in the frame of the file, or of the scene for files of tvsgs. Throws
/// Error(ExitCode::input).
PlyGeometry read_glb(const std::string& path, std::string_view bytes, bool want_colors);

}  // namespace tvsgs
