#include "mesh/fuse/marching_cubes_table.h"

#include <stdexcept>
#include <utility>
#include <vector>

namespace tvsgs {
namespace {

/// Corners of the six faces, counter-clockwise seen from outside of the cell.
constexpr int kFaces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                              {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};

int edge_between(int a, int b) {
    for (int e = 0; e < kCubeEdges; ++e) {
        const int from = edge_corner(e), to = from | 1 << edge_axis(e);
        if ((from == a && to == b) || (from == b && to == a)) return e;
    }
    throw std::logic_error("marching cubes: corners without an edge");
}

bool on_one_face(int edge_a, int edge_b) {
    for (const auto& face : kFaces) {
        int found = 0;
        for (int k = 0; k < 4; ++k) {
            const int e = edge_between(face[k], face[(k + 1) % 4]);
            found += e == edge_a || e == edge_b;
        }
        if (found == 2) return true;
    }
    return false;
}

/// Triangulates a contour as a fan, if possible without a diagonal in a face of the cell: the
/// neighbouring cell could have the same one, and the edge would get four triangles.
void add_fan(const std::vector<int>& contour, CubeCase& result) {
    const std::size_t n = contour.size();
    std::size_t best = 0, fewest = n;
    for (std::size_t start = 0; start < n; ++start) {
        std::size_t flat = 0;
        for (std::size_t k = 2; k + 1 < n; ++k)
            flat += on_one_face(contour[start], contour[(start + k) % n]);
        if (flat < fewest) fewest = flat, best = start;
    }
    for (std::size_t k = 1; k + 1 < n; ++k) {
        if (result.triangles == kMaxTriangles)
            throw std::logic_error("marching cubes: too many triangles");
        std::int8_t* triangle = result.edges + 3 * result.triangles++;
        triangle[0] = static_cast<std::int8_t>(contour[best]);
        triangle[1] = static_cast<std::int8_t>(contour[(best + k) % n]);
        triangle[2] = static_cast<std::int8_t>(contour[(best + k + 1) % n]);
    }
}

CubeCase trace(int inside) {
    // On each face, the contour runs from the edge where it enters the inside to the edge where it
    // leaves it next. Each crossed edge is entered on one of its two faces and left on the other.
    std::array<int, kCubeEdges> next;
    next.fill(-1);
    for (const auto& face : kFaces)
        for (int k = 0; k < 4; ++k) {
            const auto is_inside = [&](int i) { return (inside >> face[i % 4] & 1) != 0; };
            if (is_inside(k) || !is_inside(k + 1)) continue;
            int leave = k + 1;
            while (is_inside(leave + 1)) ++leave;
            next[edge_between(face[k], face[(k + 1) % 4])] =
                edge_between(face[leave % 4], face[(leave + 1) % 4]);
        }
    CubeCase result;
    for (int e = 0; e < kCubeEdges; ++e) {
        std::vector<int> contour;
        for (int at = e; next[at] >= 0;) {
            contour.push_back(at);
            at = std::exchange(next[at], -1);
        }
        if (!contour.empty()) add_fan(contour, result);
    }
    return result;
}

}  // namespace

std::array<CubeCase, 256> marching_cubes_table() {
    std::array<CubeCase, 256> table;
    for (int inside = 0; inside < 256; ++inside) table[inside] = trace(inside);
    return table;
}

}  // namespace tvsgs
