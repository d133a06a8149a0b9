// Triangles drawn into a z-buffer: what a camera has in front at each of its samples.
#pragma once

#include <vector>

#include "core/scene/camera.h"
#include "core/scene/mesh.h"

namespace tvsgs {

/// What is in front at the middle of each pixel, as face and barycentric coordinates.
struct Hits {
    int width = 0, height = 0;
    std::vector<float> depth;   // [H W] z-depth, world units; kNoDepth: nothing there
    std::vector<int> face;      // [H W] -1: none; empty if only depth was asked for
    std::vector<Vec2f> weight;  // [H W] of the second and third vertex; likewise

    static constexpr float kNoDepth = 1e30f;
};

enum class HitParts { all, depth };

/// Both sides of a face are drawn; it is cut at the camera plane, not lost. Of two faces at the
/// same depth the first is in front. The result does not depend on the number of threads.
Hits find_hits(const TriangleMesh& mesh, const Camera& camera, HitParts parts = HitParts::all);

}  // namespace tvsgs
