#include <algorithm>

#include "mesh/tetrahedra/tetrahedra_steps.h"

namespace tvsgs {

constexpr int kEdgeEnds[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

/// Faces as triples of edges, by a bit for each corner inside; -1 ends the list.
constexpr int kFaces[16][7] = {{-1},
                               {0, 1, 2, -1},
                               {0, 4, 3, -1},
                               {1, 2, 4, 1, 4, 3, -1},
                               {1, 3, 5, -1},
                               {0, 3, 5, 0, 5, 2, -1},
                               {0, 4, 5, 0, 5, 1, -1},
                               {2, 4, 5, -1},
                               {2, 5, 4, -1},
                               {0, 1, 5, 0, 5, 4, -1},
                               {0, 2, 5, 0, 5, 3, -1},
                               {1, 5, 3, -1},
                               {1, 3, 4, 1, 4, 2, -1},
                               {0, 3, 4, -1},
                               {0, 2, 1, -1},
                               {-1}};

TetrahedraSurface marching_tetrahedra(const std::vector<Tetrahedron>& tetrahedra,
                                      const std::vector<PointSide>& sides,
                                      const std::vector<Vec3f>& positions,
                                      const std::vector<float>& radii) {
    TetrahedraSurface surface;
    // Calls emit(keys) with the keys of the three edges of each kept face.
    const auto for_each_face = [&](const auto& emit) {
        surface.far_faces = surface.unseen_faces = 0;
        for (const Tetrahedron& t : tetrahedra) {
            int inside = 0;
            bool seen = false;
            for (int i = 0; i < 4; ++i) {
                inside |= (sides[t[i]] != PointSide::free) << i;
                seen |= sides[t[i]] == PointSide::inside;
            }
            for (const int* face = kFaces[inside]; *face >= 0; face += 3) {
                std::array<std::uint64_t, 3> keys;
                bool near = true;
                for (int k = 0; k < 3; ++k) {
                    const auto [a, b] =
                        std::minmax({t[kEdgeEnds[face[k]][0]], t[kEdgeEnds[face[k]][1]]});
                    keys[k] = static_cast<std::uint64_t>(a) << 32 | static_cast<std::uint64_t>(b);
                    near &= norm(positions[a] - positions[b]) <= radii[a] + radii[b];
                }
                if (near && seen) emit(keys);
                surface.far_faces += !near, surface.unseen_faces += near && !seen;
            }
        }
    };
    std::vector<std::uint64_t> keys;
    for_each_face([&](const auto& of) { keys.insert(keys.end(), of.begin(), of.end()); });
    surface.faces.reserve(keys.size() / 3);
    std::ranges::sort(keys);
    keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
    const auto edge_of = [&](std::uint64_t key) {
        return static_cast<int>(std::ranges::lower_bound(keys, key) - keys.begin());
    };
    for_each_face([&](const auto& of) {
        surface.faces.push_back({edge_of(of[0]), edge_of(of[1]), edge_of(of[2])});
    });
    surface.edges.reserve(keys.size());
    for (const std::uint64_t key : keys) {
        const int a = static_cast<int>(key >> 32), b = static_cast<int>(key & 0xffffffffu);
        const bool a_free = sides[a] == PointSide::free;
        surface.edges.push_back(a_free ? CrossedEdge{a, b} : CrossedEdge{b, a});
    }
    return surface;
}

}  // namespace tvsgs
