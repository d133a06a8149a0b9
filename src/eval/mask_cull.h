// Removes vertices that lie outside of the object masks, before a DTU evaluation.  [2DGS: eval_dtu]
#pragma once

#include <vector>

#include "core/math/vec.h"
#include "core/scene/image.h"

namespace tvsgs {

/// Positions and faces in double precision.
struct PreciseMesh {
    std::vector<Vec3d> vertices;
    std::vector<Vec3i> faces;
};

/// Keeps the marked vertices, and the faces whose corners are all kept.
void keep_vertices(PreciseMesh& mesh, const std::vector<char>& keep);

/// Removes vertices that are not finite, and their faces; returns the number of vertices.
std::size_t drop_non_finite(PreciseMesh& mesh);

/// A mask and its projection: pixel ~ rows * world + last.
struct MaskView {
    Vec3d rows[3], last;
    ImageU8 mask;  // [H, W, 1], 0: background
};

/// True where a pixel of `mask` that is not 0 lies within `radius` pixels.
ImageU8 dilated(const ImageU8& mask, int radius);

/// Keeps a vertex if in every view it lies outside of the image or inside the mask dilated by
/// `radius` pixels. Returns per view the number of vertices that this view rejects.
std::vector<std::size_t> cull_by_masks(PreciseMesh& mesh,
                                       const std::vector<MaskView>& views,
                                       int radius);

}  // namespace tvsgs
