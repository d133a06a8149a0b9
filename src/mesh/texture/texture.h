// Photographs onto a mesh: each face takes the view that shows it best, and what the views tell
// apart in brightness is levelled.  [Waechter14] [docs/method/texture.md]
#pragma once

#include <vector>

#include "core/scene/mesh.h"
#include "core/scene/scene.h"
#include "core/stage_clock.h"

namespace tvsgs {

struct TextureOptions {
    int max_side = 8192;      // pixels
    bool fixed_side = false;  // the width is max_side; else the smallest power of two that serves
    bool masks = true;        // what a photograph shows outside of its mask is not used
};

struct TextureReport {
    int views_used = 0;  // that a chart is of
    int charts = 0;      // connected faces of one view
    int tiles = 0;       // faces that no view shows whole
    int unseen = 0;      // of these: those that no view shows any part of
    int seams = 0;       // places that were compared along edges between views
    double scale = 1;    // texels per pixel of the photographs
    std::vector<StageTime> stages;
};

/// Colours of the surface from the photographs of `views` (those without one, photo empty, are left
/// out), one chart per connected part that one view shows best; what no view shows has the colours
/// of the vertices, grey where the mesh has none. The result does not depend on the number of
/// threads. A mesh without faces has no texture.
MeshTexture make_texture(const TriangleMesh& mesh,
                         const std::vector<View>& views,
                         const TextureOptions& options = {},
                         TextureReport* report = nullptr);

}  // namespace tvsgs
