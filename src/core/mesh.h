#pragma once

#include <cstdint>
#include <vector>

#include "core/vec.h"

namespace tvsgs {

struct TriangleMesh {
    std::vector<Vec3f> vertices;  // world units
    std::vector<Vec3f> colors;    // one per vertex, [0, 1]; empty: none
    std::vector<Vec3i> faces;     // vertex indices, counter-clockwise seen from outside
    std::vector<std::uint8_t> views =
        {};  // that surely see each vertex; 255: or more; empty: not counted
};

}  // namespace tvsgs
