// Writes an extracted mesh: its file, its texture, its axes.
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

/// Largest number of pixels along a side; 0: no texture. Throws Error(ExitCode::usage).
int texture_side(const MeshOutputOptions& options);

/// Throws Error(ExitCode::usage) unless the mesh `out` and its other files may be written; called
/// before work starts.
void require_mesh_output(const std::string& out,
                         const MeshOutputOptions& options,
                         const SceneOptions& scene);

/// Makes the mesh's texture from `views`; empty, with a logged reason, where there is none.
MeshTexture texture_of(const TriangleMesh& mesh,
                       const std::vector<View>& views,
                       const MeshOutputOptions& options,
                       bool masks,
                       const std::string& out);

/// Options of write_mesh(). `origin`: of the scene.
MeshFileOptions file_options(const MeshOutputOptions& options,
                             const std::vector<View>& views,
                             Vec3d origin);

}  // namespace tvsgs
