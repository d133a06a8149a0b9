// Texture from photographs: chooses the best view for each face and removes differences in
// brightness between views. [Waechter14] [docs/method/texture.md]
#pragma once

#include <vector>

#include "core/scene/mesh.h"
#include "core/scene/scene.h"
#include "core/stage_clock.h"

namespace tvsgs {

struct TextureOptions {
    int max_side = 8192;      // pixels
    bool fixed_side = false;  // use a width of max_side; else the smallest power of two that fits
    bool masks = true;        // use no pixels outside of the photographs' masks
};

struct TextureReport {
    int views_used = 0;  // number of views with charts
    int charts = 0;      // connected faces of one view
    int tiles = 0;       // faces that no view shows completely
    int unseen = 0;      // tiles that no view shows at all
    int seams = 0;       // sample points on edges between views
    double scale = 1;    // texels per pixel of the photographs
    std::vector<StageTime> stages;
};

/// Makes a texture from the photographs of `views` (skips views with an empty photo). Each
/// connected group of faces with the same best view becomes a chart. Faces that no view shows get
/// the vertex colours, or grey if the mesh has none. A mesh without faces has no texture.
MeshTexture make_texture(const TriangleMesh& mesh,
                         const std::vector<View>& views,
                         const TextureOptions& options = {},
                         TextureReport* report = nullptr);

}  // namespace tvsgs
