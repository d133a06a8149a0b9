// Z-buffer rasteriser for triangle meshes on the CPU.
#pragma once

#include <vector>

#include "core/scene/camera.h"
#include "core/scene/mesh.h"

namespace tvsgs {

/// The front face at each pixel centre, with barycentric coordinates.
struct Hits {
    int width = 0, height = 0;
    std::vector<float> depth;  // [H W] z-depth, world units; kNoDepth: no hit
    std::vector<int> face;     // [H W] -1: no hit; empty if only depth was requested
    // [H W] of the second and third vertex; empty if only depth was requested.
    std::vector<Vec2f> weight;

    static constexpr float kNoDepth = 1e30f;
};

enum class HitParts { all, depth };

/// Draws both sides of a face. A face that crosses the camera plane is cut there, not dropped. Of
/// two faces at the same depth the first one wins.
Hits find_hits(const TriangleMesh& mesh, const Camera& camera, HitParts parts = HitParts::all);

}  // namespace tvsgs
