// What becomes of an extracted mesh: its file, its texture, its axes.
#pragma once

#include <string>

#include "core/scene/scene.h"
#include "io/mesh/mesh_files.h"
#include "io/scene/scene_options.h"

namespace tvsgs {

struct MeshOutputOptions {
    std::string texture = "auto";
    TextureFormat texture_format = TextureFormat::jpeg;
    bool keep_axes = false, normals = false;

    template <class Visitor>
    void fields(Visitor& field) {
        field("texture", texture,
              "auto, none, or the side of the texture, 256 to 8192: auto: a texel per pixel of the "
              "photographs as far as 8192 allow");
        field.choice("texture_format", texture_format, {"jpg", "png", "webp"},
                     "of the picture in or beside the mesh");
        field("keep_axes", keep_axes, "GLB: the scene's own axes, not turned to stand upright");
        field("normals", normals,
              "GLB: with normals of the vertices, for programs that light the mesh");
    }
};

/// Pixels along a side at most; 0: no texture. Throws Error(ExitCode::usage).
int texture_side(const MeshOutputOptions& options);

/// Error(ExitCode::usage) unless a mesh called `out` may be written, with all files of it: to be
/// said before work starts.
void require_mesh_output(const std::string& out,
                         const MeshOutputOptions& options,
                         const SceneOptions& scene);

/// The texture that `views` give the mesh; empty, and why is said, where there is to be none.
MeshTexture texture_of(const TriangleMesh& mesh,
                       const std::vector<View>& views,
                       const MeshOutputOptions& options,
                       bool masks,
                       const std::string& out);

/// How write_mesh writes it. `origin`: the scene's.
MeshFileOptions file_options(const MeshOutputOptions& options,
                             const std::vector<View>& views,
                             Vec3d origin);

}  // namespace tvsgs
