#include "mesh/mesh_rims.h"

#include <algorithm>
#include <cmath>

#include "mesh/mesh_clean.h"
#include "mesh/mesh_edges.h"
#include "mesh/mesh_loops.h"
#include "mesh/mesh_sound.h"
#include "mesh/pixel_length.h"
#include "mesh/simplify_pieces.h"

namespace tvsgs {
namespace {

constexpr int kSteps = 10;
constexpr double kShrink = 0.5, kInflate = -0.53;  // of the way to the middle of the neighbours
constexpr double kLeastCosine = 0.5;               // between a face before and after
constexpr double kLeastArea = 0.1;                 // of a face, of that before
constexpr double kLeastShare = 1.0 / 16;           // of a movement; less is none

/// The sum of a face's edge vectors crossed: its normal, twice as long as its area.
Vec3d face_normal(const Vec3d corners[3]) {
    return cross(corners[1] - corners[0], corners[2] - corners[0]);
}

}  // namespace

std::size_t drop_teeth(TriangleMesh& mesh, int rounds) {
    std::vector<char> rim = find_edges(mesh).rim;
    std::vector<char> at_rim(mesh.vertices.size());
    for (std::size_t i = 0; i < rim.size(); ++i)
        if (rim[i])
            for (const std::size_t corner : {i % 3, (i + 1) % 3})
                at_rim[std::size_t(mesh.faces[i / 3][static_cast<int>(corner)])] = 1;
    // Whatever goes in any round has all its corners at what is a rim now.
    TriangleMesh part;
    std::vector<std::size_t> places;
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
        const Vec3i face = mesh.faces[f];
        if (!at_rim[std::size_t(face.x)] || !at_rim[std::size_t(face.y)] ||
            !at_rim[std::size_t(face.z)])
            continue;
        part.faces.push_back(face), places.push_back(f);
    }
    const std::vector<FaceEdge> edges = sorted_edges(part);
    std::vector<bool> keep(mesh.faces.size(), true);
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
    const std::size_t count = rims.vertices.size();
    std::vector<Vec3d> before(count), moved(count);
    std::vector<double> limits(count);
    for (std::size_t i = 0; i < count; ++i) {
        const Vec3f p = mesh.vertices[std::size_t(rims.vertices[i])];
        before[i] = vec_cast<double>(p);
        if (rims.rim_edges[i] == 2)
            limits[i] =
                static_cast<double>(limit_px) * static_cast<double>(pixel_length(cameras, p));
    }
    std::vector<Vec3d> now = before;
    for (int step = 0; step < 2 * kSteps; ++step) {
        moved = now;
        for (const std::vector<int>& loop : rims.loops)
            for (std::size_t k = 0; k < loop.size(); ++k) {
                const auto i = static_cast<std::size_t>(loop[k]);
                const auto last =
                               static_cast<std::size_t>(loop[(k + loop.size() - 1) % loop.size()]),
                           next = static_cast<std::size_t>(loop[(k + 1) % loop.size()]);
                Vec3d by =
                    (step % 2 == 0 ? kShrink : kInflate) * (0.5 * (now[last] + now[next]) - now[i]);
                by = by - dot(by, rims.normals[i]) * rims.normals[i];
                const Vec3d off = now[i] + by - before[i];
                const double length = norm(off);
                moved[i] = before[i] + (length > limits[i] ? limits[i] / length : 1) * off;
            }
        now.swap(moved);
    }
    std::vector<double> shares(count, 1);
    const auto place_at = [&](std::size_t i) {
        return vec_cast<float>(before[i] + shares[i] * (now[i] - before[i]));
    };
    for (bool undone = true; undone;) {
        undone = false;
        std::vector<char> wrong(count);
        for (const int f : rims.faces) {
            const Vec3i face = mesh.faces[std::size_t(f)];
            Vec3d from[3], to[3];
            int places[3];
            for (int k = 0; k < 3; ++k) {
                places[k] = rims.place(face[k]);
                from[k] = to[k] = vec_cast<double>(mesh.vertices[std::size_t(face[k])]);
                if (places[k] >= 0) to[k] = vec_cast<double>(place_at(std::size_t(places[k])));
            }
            const Vec3d n = face_normal(from), m = face_normal(to);
            if (dot(n, m) >= kLeastCosine * norm(n) * norm(m) && norm(m) >= kLeastArea * norm(n) &&
                has_area(vec_cast<float>(to[0]), vec_cast<float>(to[1]), vec_cast<float>(to[2])))
                continue;
            for (const int place : places)
                if (place >= 0 && shares[std::size_t(place)] > 0) wrong[std::size_t(place)] = 1;
        }
        for (std::size_t i = 0; i < count; ++i) {
            if (!wrong[i]) continue;
            undone = true;
            shares[i] = shares[i] > kLeastShare ? shares[i] / 2 : 0;
        }
    }
    std::size_t vertices = 0;
    for (std::size_t i = 0; i < count; ++i) {
        Vec3f& p = mesh.vertices[std::size_t(rims.vertices[i])];
        const Vec3f to = place_at(i);
        vertices += !(to.x == p.x && to.y == p.y && to.z == p.z);
        p = to;
    }
    return vertices;
}

}  // namespace tvsgs
