// Layout of charts and single faces in the texture.
#pragma once

#include <optional>
#include <vector>

#include "mesh/texture/texture_labels.h"

namespace tvsgs::texture {

inline constexpr int kBorder_px = 2;  // around charts and tiles: 4 pixels lie between two of them

/// A rectangle of texels.
struct Rect {
    int x = 0, y = 0, width = 0, height = 0;
};

/// Connected faces projected into one view: the texel (i, j) of its rectangle shows the pixel
/// ((left + i + 0.5) / scale, (top + j + 0.5) / scale) of the photograph.
struct Chart {
    int view = 0;
    std::vector<int> faces;
    double bounds[4];  // of the projections: least u and v, greatest u and v, pixels
    int left = 0, top = 0;
    Rect rect;
};

/// A single face, unfolded; corners in texels from the corner of its rectangle.
struct Tile {
    int face = 0;
    bool seen = false;  // views show parts of it; else it gets its vertex colours
    double length = 0;  // of its longest edge, in pixels
    double finest = 0;  // world units per pixel of the best view; 0: none
    int first = 0;      // the corner where its longest edge starts
    Vec2<double> corners[3];
    Rect rect;
    int same_as = -1;  // index of a tile of the same colour to use instead; -1: none
};

struct Atlas {
    int width = 0, height = 0;
    double scale = 1;  // texels per pixel
    std::vector<Chart> charts;
    std::vector<Tile> tiles;
};

/// Packs charts of faces with a view and tiles of the others into shelves, the highest first.
/// Shrinks them in steps of 5 % until they fit into `max_side`.
Atlas lay_out(const TriangleMesh& mesh,
              const std::vector<PhotoView>& views,
              const Candidates& candidates,
              const std::vector<int>& view_of_face,
              const std::vector<SharedEdge>& edges,
              int max_side,
              bool fixed_side);

}  // namespace tvsgs::texture
