#include "mesh/simplify/simplify_proof.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/device/parallel.h"

namespace tvsgs {
namespace {

constexpr std::size_t kMaxPoints = 1 << 18;  // in one direction
constexpr std::size_t kChunk = 1024;         // consecutive points of a parallel task

/// Calls action(first, last) for chunks of [0, count).
template <class Action>
void for_chunks(std::size_t count, const Action& action) {
    parallel_for_heavy(Cpu{}, static_cast<int>((count + kChunk - 1) / kChunk), [&](int chunk) {
        const std::size_t first = std::size_t(chunk) * kChunk;
        action(first, std::min(count, first + kChunk));
    });
}

/// Vertices first; then, for each face, its centre and the midpoints between centre and corners.
Vec3f place_on(const TriangleMesh& mesh, std::size_t i) {
    if (i < mesh.vertices.size()) return mesh.vertices[i];
    i -= mesh.vertices.size();
    const Vec3i face = mesh.faces[i / 4];
    const int near = static_cast<int>(i % 4);  // corner; 3: none
    Vec3d out;
    for (int k = 0; k < 3; ++k)
        out += (near == 3   ? 1.0 / 3
                : near == k ? 2.0 / 3
                            : 1.0 / 6) *
               vec_cast<double>(mesh.vertices[face[k]]);
    return vec_cast<float>(out);
}

void add_distances(const MeasuredMesh& from,
                   const TriangleTree& to,
                   std::vector<double>& out,
                   SimplifyProof& proof) {
    const std::size_t count = from.places.points.size(), before = out.size();
    out.resize(before + count);
    for_chunks(count, [&](std::size_t first, std::size_t last) {
        std::size_t start = 0;
        for (std::size_t i = first; i < last; ++i)
            out[before + i] = to.distance(vec_cast<double>(from.places.points[i]),
                                          std::numeric_limits<double>::infinity(), &start) /
                              double(from.pixel_lengths[i]);
    });
    proof.points += count, proof.all_points += from.places.all;
}

}  // namespace

SurfacePlaces places_on(const TriangleMesh& mesh) {
    SurfacePlaces places{{}, mesh.vertices.size() + 4 * mesh.faces.size()};
    const std::size_t stride = (places.all + kMaxPoints - 1) / kMaxPoints;
    places.points.resize(stride > 0 ? (places.all + stride - 1) / stride : 0);
    parallel_for(Cpu{}, static_cast<int>(places.points.size()),
                 [&](int i) { places.points[i] = place_on(mesh, std::size_t(i) * stride); });
    return places;
}

SimplifyProof measure(const MeasuredMesh& original, const MeasuredMesh& simplified) {
    SimplifyProof proof;
    std::vector<double> distances;
    add_distances(original, simplified.tree, distances, proof);
    add_distances(simplified, original.tree, distances, proof);
    if (distances.empty()) return proof;
    double sum = 0;
    for (const double d : distances) sum += d, proof.max_px = std::max(proof.max_px, d);
    proof.mean_px = sum / static_cast<double>(distances.size());
    const auto place = distances.begin() + std::ptrdiff_t(0.999 * double(distances.size() - 1));
    std::nth_element(distances.begin(), place, distances.end());
    proof.p999_px = *place;
    return proof;
}

void carry_colors(const TriangleMesh& original, const TriangleTree& tree, TriangleMesh& mesh) {
    mesh.colors.resize(mesh.vertices.size());
    for_chunks(mesh.vertices.size(), [&](std::size_t first, std::size_t last) {
        std::size_t start = 0;
        for (std::size_t i = first; i < last; ++i) {
            const Vec3d p = vec_cast<double>(mesh.vertices[i]);
            tree.distance(p, std::numeric_limits<double>::infinity(), &start);
            const Vec3i face = original.faces[tree.face(start)];
            Vec3d corners[3], color;
            for (int k = 0; k < 3; ++k) corners[k] = vec_cast<double>(original.vertices[face[k]]);
            const Vec3d q = closest_on_triangle(p, corners[0], corners[1], corners[2]);
            // Barycentric weights by area; by distance if there is no area.
            double shares[3], sum = 0;
            for (int k = 0; k < 3; ++k) {
                shares[k] = norm(cross(corners[(k + 1) % 3] - q, corners[(k + 2) % 3] - q));
                sum += shares[k];
            }
            for (int k = 0; k < 3; ++k)
                color += (sum > 0 ? shares[k] / sum : 1.0 / 3) *
                         vec_cast<double>(original.colors[face[k]]);
            mesh.colors[i] = vec_cast<float>(color);
        }
    });
}

}  // namespace tvsgs
