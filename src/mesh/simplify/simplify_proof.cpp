#include <algorithm>
#include <cmath>
#include <limits>

#include "core/device/parallel.h"
#include "mesh/draw/mesh_render.h"
#include "mesh/fuse/depth_view.h"
#include "mesh/simplify/simplify_steps.h"

namespace tvsgs {
namespace {

constexpr float kBehindPx = 1;  // a vertex up to so far behind the depth map is visible

constexpr float kNone = std::numeric_limits<float>::infinity();
constexpr float kShortest = 1e-30f, kLongest = 1e30f;

/// Pixel length by distance, for the camera where it is least.
float nearest_pixel(Vec3f point, const std::vector<Camera>& cameras) {
    float nearest = kNone;
    for (const Camera& camera : cameras)
        nearest = std::min(
            nearest, norm(point - camera_centre(camera)) / std::max(camera.fx_px, camera.fy_px));
    return nearest;
}

/// The farthest of the four pixel centres around (u, v); infinite if one has no surface.
float farthest_around(const ImageF& depth, float u, float v) {
    float farthest = 0;
    for (const float du : {-0.5f, 0.5f})
        for (const float dv : {-0.5f, 0.5f}) {
            const int x = std::clamp(static_cast<int>(std::floor(u + du)), 0, depth.width - 1);
            const int y = std::clamp(static_cast<int>(std::floor(v + dv)), 0, depth.height - 1);
            const float d = depth.at(x, y);
            farthest = std::max(farthest, d > 0 ? d : std::numeric_limits<float>::infinity());
        }
    return farthest;
}

constexpr std::size_t kMaxPoints = 1 << 18;  // in one direction

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
    std::vector<Vec3d> points;
    for (const Vec3f& p : from.places.points) points.push_back(vec_cast<double>(p));
    const std::vector<double> distances = to.distances(points);
    for (std::size_t i = 0; i < points.size(); ++i)
        out.push_back(distances[i] / double(from.pixel_lengths[i]));
    proof.points += points.size(), proof.all_points += from.places.all;
}

}  // namespace

std::vector<float> pixel_lengths(const TriangleMesh& mesh,
                                 const std::vector<Vec3f>& points,
                                 const std::vector<Camera>& cameras) {
    const int count = static_cast<int>(points.size());
    std::vector<float> seen(points.size(), kNone), in_image = seen;
    for (const Camera& camera : cameras) {
        const ImageF depth = render_depth(mesh, camera);
        const float focal_px = std::max(camera.fx_px, camera.fy_px);
        parallel_for(Cpu{}, count, [&](int v) {
            const Vec3f p = camera.camera_from_world * points[v];
            const float length = p.z / focal_px;
            if (length >= seen[v] || !is_in_view(camera, points[v])) return;
            in_image[v] = std::min(in_image[v], length);
            const float surface = farthest_around(depth, camera.fx_px * p.x / p.z + camera.cx_px,
                                                  camera.fy_px * p.y / p.z + camera.cy_px);
            if (p.z <= surface + kBehindPx * length) seen[v] = length;
        });
    }
    parallel_for(Cpu{}, count, [&](int v) {
        if (seen[v] == kNone)
            seen[v] = kUnseenPixels *
                      (in_image[v] < kNone ? in_image[v] : nearest_pixel(points[v], cameras));
        seen[v] = std::clamp(seen[v], kShortest, kLongest);
    });
    return seen;
}

std::vector<float> least_pixel_lengths(const std::vector<Vec3f>& points,
                                       const std::vector<Camera>& cameras) {
    std::vector<float> out(points.size());
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) {
        const Vec3f point = points[i];
        float least = pixel_length(cameras, point);
        if (least == 0) least = kUnseenPixels * nearest_pixel(point, cameras);
        out[i] = std::clamp(least, kShortest, kLongest);
    });
    return out;
}

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
    constexpr std::size_t kChunk = 1024;  // consecutive points of a parallel task
    const std::size_t count = mesh.vertices.size();
    parallel_for_heavy(Cpu{}, static_cast<int>((count + kChunk - 1) / kChunk), [&](int chunk) {
        std::size_t start = 0, i = std::size_t(chunk) * kChunk;
        for (const std::size_t last = std::min(count, i + kChunk); i < last; ++i) {
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
