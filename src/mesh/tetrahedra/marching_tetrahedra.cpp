#include "mesh/tetrahedra/marching_tetrahedra.h"

#include <algorithm>

namespace tvsgs {
namespace {

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

class March {
public:
    March(const std::vector<PointSide>& sides,
          const std::vector<Vec3f>& positions,
          const std::vector<float>& radii)
        : sides_(sides), positions_(positions), radii_(radii) {}

    TetrahedraSurface surface;

    /// Calls emit(keys) with the keys of the three edges of each kept face.
    template <class Emit>
    void for_each_face(const std::vector<Tetrahedron>& tetrahedra, const Emit& emit) {
        surface.far_faces = surface.unseen_faces = 0;
        for (const Tetrahedron& t : tetrahedra) {
            int inside = 0;
            bool seen = false;
            for (int i = 0; i < 4; ++i) {
                const PointSide side = sides_[index(t[i])];
                inside |= (side != PointSide::free) << i;
                seen |= side == PointSide::inside;
            }
            for (const int* face = kFaces[inside]; *face >= 0; face += 3) {
                std::uint64_t keys[3];
                bool near = true;
                for (int k = 0; k < 3; ++k) {
                    const int* ends = kEdgeEnds[face[k]];
                    const int a = t[ends[0]], b = t[ends[1]];
                    keys[k] = static_cast<std::uint64_t>(std::min(a, b)) << 32 |
                              static_cast<std::uint64_t>(std::max(a, b));
                    near &= norm(positions_[index(a)] - positions_[index(b)]) <=
                            radii_[index(a)] + radii_[index(b)];
                }
                if (!near)
                    ++surface.far_faces;
                else if (!seen)
                    ++surface.unseen_faces;
                else
                    emit(keys);
            }
        }
    }

private:
    static std::size_t index(int i) { return static_cast<std::size_t>(i); }

    const std::vector<PointSide>& sides_;
    const std::vector<Vec3f>& positions_;
    const std::vector<float>& radii_;
};

}  // namespace

TetrahedraSurface marching_tetrahedra(const std::vector<Tetrahedron>& tetrahedra,
                                      const std::vector<PointSide>& sides,
                                      const std::vector<Vec3f>& positions,
                                      const std::vector<float>& radii) {
    March march(sides, positions, radii);
    std::vector<std::uint64_t> keys;
    std::size_t faces = 0;
    march.for_each_face(tetrahedra, [&](const std::uint64_t(&of)[3]) {
        keys.insert(keys.end(), of, of + 3);
        ++faces;
    });
    std::sort(keys.begin(), keys.end());
    keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
    march.surface.faces.reserve(faces);
    const auto edge_of = [&](std::uint64_t key) {
        return static_cast<int>(std::lower_bound(keys.begin(), keys.end(), key) - keys.begin());
    };
    march.for_each_face(tetrahedra, [&](const std::uint64_t(&of)[3]) {
        march.surface.faces.push_back({edge_of(of[0]), edge_of(of[1]), edge_of(of[2])});
    });
    march.surface.edges.reserve(keys.size());
    for (const std::uint64_t key : keys) {
        const int a = static_cast<int>(key >> 32), b = static_cast<int>(key & 0xffffffffu);
        const bool a_free = sides[a] == PointSide::free;
        march.surface.edges.push_back(a_free ? CrossedEdge{a, b} : CrossedEdge{b, a});
    }
    return std::move(march.surface);
}

}  // namespace tvsgs
