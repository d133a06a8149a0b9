#include "mesh/mend/mesh_corners.h"

#include <algorithm>
#include <utility>

#include "core/device/parallel.h"
#include "core/error.h"

namespace tvsgs {
namespace {

/// Atomic *target += 1; returns the old value.
std::uint32_t count_up(std::uint32_t* target) {
    return __atomic_fetch_add(target, 1u, __ATOMIC_RELAXED);
}

/// A face by its two greater corners.
struct Face {
    int low, high;
    std::uint32_t face;
    auto operator<=>(const Face&) const = default;
};

}  // namespace

Corners::Corners(const std::vector<Vec3i>& faces, std::size_t vertices)
    : first_(vertices + 2), corners_(3 * faces.size()) {
    const int count = static_cast<int>(faces.size());
    parallel_for(Cpu{}, count, [&](int f) {
        for (int k = 0; k < 3; ++k) count_up(&first_[std::size_t(faces[f][k]) + 2]);
    });
    for (std::size_t v = 2; v < first_.size(); ++v) first_[v] += first_[v - 1];
    parallel_for(Cpu{}, count, [&](int f) {
        for (int k = 0; k < 3; ++k)
            corners_[count_up(&first_[std::size_t(faces[f][k]) + 1])] =
                3 * static_cast<std::uint32_t>(f) + static_cast<std::uint32_t>(k);
    });
    first_.pop_back();
    // Restores the order, which depends on the threads.
    parallel_for(Cpu{}, static_cast<int>(vertices), [&](int v) {
        std::sort(corners_.begin() + first_[v], corners_.begin() + first_[std::size_t(v) + 1]);
    });
}

SurfaceEdges find_edges(const TriangleMesh& mesh, const Corners& corners) {
    SurfaceEdges edges{std::vector<char>(3 * mesh.faces.size()),
                       std::vector<char>(mesh.vertices.size())};
    parallel_for(Cpu{}, static_cast<int>(mesh.vertices.size()), [&](int v) {
        thread_local std::vector<int> ring;  // neighbours of the vertex, two for each of its faces
        ring.clear();
        corners.for_each(v, [&](std::uint32_t f, int k) {
            for (const int step : {1, 2}) ring.push_back(mesh.faces[f][(k + step) % 3]);
        });
        std::ranges::sort(ring);
        const auto count = [&](int w) {
            const auto [first, last] = std::equal_range(ring.begin(), ring.end(), w);
            return last - first;
        };
        corners.for_each(v, [&](std::uint32_t f, int k) {
            const auto out = count(mesh.faces[f][(k + 1) % 3]),
                       in = count(mesh.faces[f][(k + 2) % 3]);
            if (out == 1) edges.boundary[3 * f + std::size_t(k)] = 1;
            if (out > 2 || in > 2) edges.fixed[v] = 1;
        });
    });
    return edges;
}

void check_indices(const TriangleMesh& mesh) {
    const int vertices = static_cast<int>(mesh.vertices.size());
    const auto out_of_range = [vertices](int v) { return v < 0 || v >= vertices; };
    const auto count = static_cast<std::int64_t>(mesh.faces.size());
    std::int64_t wrong = count;
    parallel_for(Cpu{}, static_cast<int>(count), [&](int f) {
        for (int k = 0; k < 3; ++k)
            if (out_of_range(mesh.faces[f][k])) min_atomically(&wrong, f);
    });
    if (wrong == count) return;
    const Vec3i face = mesh.faces[wrong];
    const int k = out_of_range(face.x) ? 0 : out_of_range(face.y) ? 1 : 2;
    throw Error(ExitCode::input, "face ", wrong, " refers to vertex ", face[k],
                ", but the mesh has ", vertices);
}

std::size_t drop_flawed_faces(TriangleMesh& mesh) {
    check_indices(mesh);
    return drop_faces(mesh, [&](std::size_t f) {
        const Vec3i face = mesh.faces[f];
        const auto finite = [&](int v) { return is_finite(mesh.vertices[v]); };
        return repeats_corner(face) || !finite(face.x) || !finite(face.y) || !finite(face.z);
    });
}

Corners drop_repeated_faces(TriangleMesh& mesh) {
    Corners corners(mesh);
    std::vector<char> repeated(mesh.faces.size());
    parallel_for(Cpu{}, static_cast<int>(mesh.vertices.size()), [&](int v) {
        thread_local std::vector<Face> found;
        found.clear();
        corners.for_each(v, [&](std::uint32_t f, int k) {
            const Vec3i face = mesh.faces[f];
            const auto [low, high] = std::minmax({face[(k + 1) % 3], face[(k + 2) % 3]});
            if (v <= low) found.push_back({low, high, f});  // checked at its smallest corner
        });
        std::ranges::sort(found);
        for (std::size_t i = 1; i < found.size(); ++i)
            if (found[i].low == found[i - 1].low && found[i].high == found[i - 1].high)
                repeated[found[i].face] = 1;
    });
    const bool none = drop_faces(mesh, [&](std::size_t f) { return repeated[f] != 0; }) == 0;
    return none ? std::move(corners) : Corners(mesh);
}

}  // namespace tvsgs
