// Output of an extracted mesh: its files, texture, axes and summary.
#pragma once

#include <string>

#include "core/scene/scene.h"
#include "io/mesh/mesh_files.h"
#include "io/scene/scene_options.h"
#include "pipeline/mesh/mesh_extraction.h"

namespace tvsgs {

struct MeshOutputOptions {
    std::string texture = "auto";
    TextureFormat texture_format = TextureFormat::jpeg;
    bool keep_axes = false, normals = false;

    template <class Visitor>
    void fields(Visitor& field) {
        field("texture", texture,
              "auto, none, or the side of the texture, 256 to 8192; auto: one texel per pixel of "
              "the photographs, up to 8192");
        field.choice("texture_format", texture_format, {"jpg", "png", "webp"},
                     "image format of the texture");
        field("keep_axes", keep_axes, "GLB: keep the scene's axes instead of standing it upright");
        field("normals", normals, "GLB: write vertex normals, for programs that light the mesh");
    }
};

/// Maximum side in pixels; 0: no texture. Throws Error(ExitCode::usage).
int texture_side(const MeshOutputOptions& options);

/// Throws Error(ExitCode::usage) unless the mesh `out` and all of its files may be written; call it
/// before work starts.
void require_mesh_output(const std::string& out,
                         const MeshOutputOptions& options,
                         const SceneOptions& scene);

/// Makes the texture from `views`; empty, with a warning, if there can be none.
MeshTexture texture_of(const TriangleMesh& mesh,
                       const std::vector<View>& views,
                       const MeshOutputOptions& options,
                       bool masks,
                       const std::string& out);

/// "Mesh: 2,419 faces, 1 component (113 small ones removed), texture 256x256".
std::string summary_text(const MeshSummary& summary,
                         const TriangleMesh& mesh,
                         const MeshTexture& texture);

/// "Left out: 24 % of the surface, ..."; empty below half a percent.
std::string left_out_text(const MeshSummary& summary);

/// Options of write_mesh(). `origin`: the scene's.
MeshFileOptions file_options(const MeshOutputOptions& options,
                             const std::vector<View>& views,
                             Vec3d origin);

}  // namespace tvsgs
