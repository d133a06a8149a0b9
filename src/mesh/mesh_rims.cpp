#include "mesh/mesh_rims.h"

#include <algorithm>
#include <cmath>

#include "core/parallel_lists.h"
#include "mesh/mesh_clean.h"
#include "mesh/mesh_corners.h"
#include "mesh/mesh_edges.h"
#include "mesh/mesh_loops.h"
#include "mesh/mesh_sound.h"
#include "mesh/pixel_length.h"

namespace tvsgs {
namespace {

constexpr int kSteps = 10;
constexpr double kShrink = 0.5, kInflate = -0.53;  // of the way to the middle of the neighbours
constexpr double kLeastCosine = 0.5;               // between a face before and after
constexpr double kLeastArea = 0.1;                 // of a face, of that before
constexpr double kLeastShare = 1.0 / 16;           // of a movement; less is none

/// Twice as long as the face's area.
Vec3d face_normal(const Vec3f corners[3]) {
    const Vec3d a = vec_cast<double>(corners[0]);
    return cross(vec_cast<double>(corners[1]) - a, vec_cast<double>(corners[2]) - a);
}

/// Whether a face that is moved neither turns over nor shrinks to nothing.
bool is_like(const Vec3f before[3], const Vec3f after[3]) {
    const Vec3d n = face_normal(before), m = face_normal(after);
    return dot(n, m) >= kLeastCosine * norm(n) * norm(m) && norm(m) >= kLeastArea * norm(n) &&
           has_area(after[0], after[1], after[2]);
}

/// Where Taubin's steps along the loops lead, within the planes of the surface and balls of radius
/// `limits` about the points.
std::vector<Vec3d> smoothed(const Rims& rims,
                            const std::vector<Vec3d>& points,
                            const std::vector<double>& limits) {
    std::vector<Vec3d> now = points, next = points;
    for (int step = 0; step < 2 * kSteps; ++step) {
        const double factor = step % 2 == 0 ? kShrink : kInflate;
        for (const std::vector<int>& loop : rims.loops)
            for (std::size_t k = 0; k < loop.size(); ++k) {
                const auto at = [&](std::size_t l) { return std::size_t(loop[l % loop.size()]); };
                const std::size_t i = at(k);
                const Vec3d middle = 0.5 * (now[at(k + loop.size() - 1)] + now[at(k + 1)]);
                const Vec3d by = factor * (middle - now[i]), n = rims.normals[i];
                const Vec3d off = now[i] - points[i] + by - dot(by, n) * n;
                const double length = norm(off);
                next[i] = points[i] + (length > limits[i] ? limits[i] / length : 1) * off;
            }
        now = next;
    }
    return now;
}

/// As far on the ways from `before` to `after` as no face turns over.
std::vector<Vec3f> unfolded(const TriangleMesh& mesh,
                            const Rims& rims,
                            const std::vector<Vec3d>& before,
                            const std::vector<Vec3d>& after) {
    std::vector<double> shares(before.size(), 1);
    std::vector<Vec3f> places(before.size());
    for (bool undone = true; undone;) {
        for (std::size_t i = 0; i < places.size(); ++i)
            places[i] = vec_cast<float>(before[i] + shares[i] * (after[i] - before[i]));
        std::vector<char> wrong(before.size());
        for (const int f : rims.faces) {
            const Vec3i face = mesh.faces[std::size_t(f)];
            Vec3f from[3], to[3];
            int at[3]{};
            for (int k = 0; k < 3; ++k) {
                at[k] = rims.place(face[k]);
                from[k] = mesh.vertices[std::size_t(face[k])];
                to[k] = at[k] < 0 ? from[k] : places[std::size_t(at[k])];
            }
            if (is_like(from, to)) continue;
            for (const int place : at)
                if (place >= 0) wrong[std::size_t(place)] = 1;
        }
        undone = false;
        for (std::size_t i = 0; i < shares.size(); ++i) {
            if (!wrong[i] || shares[i] == 0) continue;
            undone = true;
            shares[i] = shares[i] > kLeastShare ? shares[i] / 2 : 0;
        }
    }
    return places;
}

}  // namespace

std::size_t drop_teeth(TriangleMesh& mesh, int rounds) {
    std::vector<char> rim = find_edges(mesh).rim;
    const std::vector<char> at_rim = vertices_at_rims(mesh, rim);
    // Whatever goes in any round has all its corners at what is a rim now.
    const std::vector<int> numbers = numbers_where(mesh.faces.size(), [&](std::size_t f) {
        const Vec3i face = mesh.faces[f];
        return at_rim[std::size_t(face.x)] && at_rim[std::size_t(face.y)] &&
               at_rim[std::size_t(face.z)];
    });
    const std::vector<std::size_t> places(numbers.begin(), numbers.end());
    TriangleMesh part;
    part.faces = taken(mesh.faces, numbers);
    const std::vector<FaceEdge> edges = sorted_edges(part);
    std::vector<char> keep(mesh.faces.size(), 1);
    std::vector<std::size_t> teeth;
    std::size_t dropped = 0;
    for (int round = 0; round < rounds; ++round) {
        teeth.clear();
        for (const std::size_t f : places)
            if (keep[f] && rim[3 * f] + rim[3 * f + 1] + rim[3 * f + 2] >= 2) teeth.push_back(f);
        for (const std::size_t f : teeth) keep[f] = false;
        for (std::size_t i = 1; i < edges.size(); ++i) {
            if (edges[i].key != edges[i - 1].key) continue;
            const auto at = [&](const FaceEdge& edge) {
                return 3 * places[std::size_t(edge.face)] + std::size_t(edge.corner);
            };
            const std::size_t a = at(edges[i - 1]), b = at(edges[i]);
            if (!keep[a / 3]) rim[b] = 1;
            if (!keep[b / 3]) rim[a] = 1;
        }
        dropped += teeth.size();
    }
    if (dropped > 0) filter_faces(mesh, keep);
    return dropped;
}

std::size_t smooth_rims(TriangleMesh& mesh, const std::vector<Camera>& cameras, float limit_px) {
    if (!(limit_px > 0)) return 0;
    const Rims rims = find_rims(mesh);
    std::vector<Vec3d> before;
    std::vector<double> limits;
    for (std::size_t i = 0; i < rims.vertices.size(); ++i) {
        const Vec3f p = mesh.vertices[std::size_t(rims.vertices[i])];
        before.push_back(vec_cast<double>(p));
        const bool touches = rims.rim_edges[i] > 2;
        limits.push_back(touches ? 0.0 : static_cast<double>(limit_px * pixel_length(cameras, p)));
    }
    const std::vector<Vec3d> after = smoothed(rims, before, limits);
    const std::vector<Vec3f> places = unfolded(mesh, rims, before, after);
    std::size_t moved = 0;
    for (std::size_t i = 0; i < places.size(); ++i) {
        Vec3f& p = mesh.vertices[std::size_t(rims.vertices[i])];
        moved += !(places[i].x == p.x && places[i].y == p.y && places[i].z == p.z);
        p = places[i];
    }
    return moved;
}

}  // namespace tvsgs
