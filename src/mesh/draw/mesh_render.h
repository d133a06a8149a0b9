// Pictures of triangle meshes: a z-buffer renderer on the CPU, for synthetic scenes and for
// previews.
#pragma once

#include "core/scene/camera.h"
#include "core/scene/image.h"
#include "core/scene/mesh.h"

namespace tvsgs {

struct MeshRenderOptions {
    int supersampling =
        1;  // colour is the mean of n x n samples per pixel; the maps sample pixel centres
    Vec3f background{0, 0, 0};
    bool smooth_normals = true;  // interpolated vertex normals; else the normal of the face
};

/// What a camera sees of a mesh. The maps hold the surface hit by the ray of each pixel centre.
struct MeshRender {
    ImageF color;  // [H W 3] the texture, or perspective-correct vertex colours; white without any
    ImageF depth;  // [H W 1] z-depth, world units; 0: nothing hit
    ImageF
        normal;  // [H W 3] camera frame, unit, out of the surface (may face away); 0: nothing hit
    Image<int> face;  // [H W 1] index of the face; -1: nothing hit
};

/// Both sides of a face are drawn. The result does not depend on the number of threads. A face is
/// cut at the camera plane, not lost.
MeshRender render_mesh(const TriangleMesh& mesh,
                       const Camera& camera,
                       const MeshRenderOptions& options = {},
                       const MeshTexture& texture = {});

/// The depth map of render_mesh alone.
ImageF render_depth(const TriangleMesh& mesh, const Camera& camera);

/// Camera that looks as the middle one of `cameras` (one at least) does and frames the bulk of the
/// vertices, outliers aside.
Camera preview_camera(const TriangleMesh& mesh,
                      const std::vector<Camera>& cameras,
                      int width,
                      int height);

/// RGB picture for people: the texture, vertex colours or grey, lit from the camera; the inner side
/// of the surface is tinted red, so that holes and inverted parts show.
ImageU8 preview_mesh(const TriangleMesh& mesh,
                     const Camera& camera,
                     const MeshTexture& texture = {});

/// Mean of n x n pixels each; the size must be a multiple of n.
ImageF box_filter(const ImageF& image, int n);

/// Values in [0, 1] to 8 bits, rounded and clamped.
ImageU8 to_8bit(const ImageF& image);

}  // namespace tvsgs
