#include "mesh/mend/mesh_corners.h"

#include <algorithm>
#include <array>
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

/// Neighbours of a vertex: two for each of its faces. Usually few.
class Ring {
public:
    void clear() { size_ = 0, many_.clear(); }
    void add(int w) {
        if (size_ < kFew) {
            few_[size_++] = w;
        } else {
            if (many_.empty()) many_.assign(few_.begin(), few_.end());
            many_.push_back(w);
        }
    }
    /// Call before count().
    void close() { std::sort(many_.begin(), many_.end()); }
    std::ptrdiff_t count(int w) const {
        if (many_.empty()) return std::count(few_.begin(), few_.begin() + size_, w);
        const auto [first, last] = std::equal_range(many_.begin(), many_.end(), w);
        return last - first;
    }

private:
    static constexpr int kFew = 24;
    std::array<int, kFew> few_;
    int size_ = 0;
    std::vector<int> many_;  // all of them, if there are more
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
        Ring ring;
        corners.for_each(v, [&](std::uint32_t f, int k) {
            for (const int step : {1, 2}) ring.add(mesh.faces[f][(k + step) % 3]);
        });
        ring.close();
        corners.for_each(v, [&](std::uint32_t f, int k) {
            const std::ptrdiff_t out = ring.count(mesh.faces[f][(k + 1) % 3]),
                                 in = ring.count(mesh.faces[f][(k + 2) % 3]);
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
    throw Error(ExitCode::input, str("face ", wrong, " refers to vertex ", face[k],
                                     ", but the mesh has ", vertices));
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
        std::array<Face, 16> few;
        std::vector<Face> many;
        std::size_t count = 0;
        corners.for_each(v, [&](std::uint32_t f, int k) {
            const Vec3i face = mesh.faces[f];
            const auto [low, high] = std::minmax({face[(k + 1) % 3], face[(k + 2) % 3]});
            if (v > low) return;  // the face is checked at its smallest corner
            if (count < few.size()) few[count] = {low, high, f};
            if (count == few.size()) many.assign(few.begin(), few.end());
            if (count >= few.size()) many.push_back({low, high, f});
            ++count;
        });
        Face* const first = many.empty() ? few.data() : many.data();
        std::sort(first, first + count);
        for (std::size_t i = 1; i < count; ++i)
            if (first[i].low == first[i - 1].low && first[i].high == first[i - 1].high)
                repeated[first[i].face] = 1;
    });
    const bool none = drop_faces(mesh, [&](std::size_t f) { return repeated[f] != 0; }) == 0;
    return none ? std::move(corners) : Corners(mesh);
}

}  // namespace tvsgs
