// Where the faces lie in the texture.
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

/// Connected faces as one view shows them: the texel (i, j) of its rectangle shows the pixel
/// ((left + i + 0.5) / scale, (top + j + 0.5) / scale) of the photograph.
struct Chart {
    int view = 0;
    std::vector<int> faces;
    double bounds[4];  // of the projections: least u and v, greatest u and v, pixels
    int left = 0, top = 0;
    Rect rect;
};

/// A face of its own, unfolded: corners in texels from the corner of its rectangle.
struct Tile {
    int face = 0;
    bool seen = false;  // views show parts of it; else the colours of its vertices
    double length = 0;  // of its longest edge, in pixels
    double finest = 0;  // world units per pixel of the view that sees it best; 0: none
    int first = 0;      // the corner of the face from which that edge goes
    Vec2<double> corners[3];
    Rect rect;
    int same_as = -1;  // another tile that has its colour
};

struct Atlas {
    int width = 0, height = 0;
    double scale = 1;  // texels per pixel
    std::vector<Chart> charts;
    std::vector<Tile> tiles;
};

/// Charts of the faces' views and tiles of the others, packed by shelves, the highest first. They
/// become smaller by steps of 5 % until they fit into `max_side`.
Atlas lay_out(const TriangleMesh& mesh,
              const std::vector<PhotoView>& views,
              const Candidates& candidates,
              const std::vector<int>& view_of_face,
              const std::vector<SharedEdge>& edges,
              int max_side,
              bool fixed_side);

}  // namespace tvsgs::texture
