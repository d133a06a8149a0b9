// Renders triangle meshes on the CPU, for synthetic scenes and previews, and finds the upright
// orientation of a scene from its cameras.
#pragma once

#include <vector>

#include "core/scene/camera.h"
#include "core/scene/image.h"
#include "core/scene/mesh.h"

namespace tvsgs {

struct MeshRenderOptions {
    // Colour is the mean of n x n samples per pixel; the maps sample pixel centres.
    int supersampling = 1;
    Vec3f background{0, 0, 0};
    bool smooth_normals = true;  // interpolate vertex normals; else use the normal of the face
};

/// Image and maps of a mesh. The maps hold the surface that the ray of each pixel centre hits.
struct MeshRender {
    ImageF color;   // [H W 3] texture, or perspective-correct vertex colours; white without either
    ImageF depth;   // [H W 1] z-depth, world units; 0: no hit
    ImageF normal;  // [H W 3] camera frame, unit, out of the surface (may face away); 0: no hit
    Image<int> face;  // [H W 1] index of the face; -1: no hit
};

/// Draws both sides of a face. A face that crosses the camera plane is cut there, not dropped.
MeshRender render_mesh(const TriangleMesh& mesh,
                       const Camera& camera,
                       const MeshRenderOptions& options = {},
                       const MeshTexture& texture = {});

/// Only the depth map of render_mesh().
ImageF render_depth(const TriangleMesh& mesh, const Camera& camera);

/// Only the faces of render_mesh().
Image<int> render_faces(const TriangleMesh& mesh, const Camera& camera);

/// Camera with the orientation of the middle one of `cameras` (at least one) that frames most of
/// the vertices, without outliers.
Camera preview_camera(const TriangleMesh& mesh,
                      const std::vector<Camera>& cameras,
                      int width,
                      int height);

/// RGB preview: texture, vertex colours or grey, lit from the camera. Back faces are tinted red to
/// show holes and inverted parts.
ImageU8 preview_mesh(const TriangleMesh& mesh,
                     const Camera& camera,
                     const MeshTexture& texture = {});

/// Averages n x n pixels; the size must be a multiple of n.
ImageF box_filter(const ImageF& image, int n);

/// Converts [0, 1] to 8 bits, rounded and clamped.
ImageU8 to_8bit(const ImageF& image);

/// Rotation of a scene (in any frame) that makes it stand upright in viewers: +y is up, and the
/// middle one of `cameras` looks from +z. Up is perpendicular to the cameras' pixel rows, because
/// people hold cameras level, on the side of the mean upward axis; cameras that look along it look
/// down. `cameras`: of upright photographs. [docs/method/texture.md#upright]
Mat3<double> upright_from_scene(const std::vector<Camera>& cameras);

}  // namespace tvsgs
