// Triangle meshes and their textures.
#pragma once

#include <cstdint>
#include <vector>

#include "core/math/vec.h"
#include "core/scene/image.h"

namespace tvsgs {

struct TriangleMesh {
    std::vector<Vec3f> vertices;  // world units
    std::vector<Vec3f> colors;    // one per vertex, [0, 1]; empty: none
    std::vector<Vec3i> faces;     // vertex indices, counter-clockwise seen from outside
    /// Number of views that surely see each vertex (255: or more); empty: not counted.
    std::vector<std::uint8_t> views = {};
};

/// Texture of a mesh in one image. A vertex has one texture coordinate for each chart that contains
/// it.
struct MeshTexture {
    ImageU8 image;              // [H W 3]; empty: the mesh has no texture
    std::vector<Vec2f> places;  // [0, 1], right and down from the top left corner of the image
    std::vector<Vec3i> faces;   // one per face of the mesh: indices into `places`

    bool empty() const { return image.empty(); }
};

/// Normals of the vertices: mean of the normals of the adjacent faces, weighted by area, unit
/// length; 0 for unused vertices.
inline std::vector<Vec3f> vertex_normals(const TriangleMesh& mesh) {
    std::vector<Vec3d> sums(mesh.vertices.size());
    for (const Vec3i face : mesh.faces) {
        const Vec3d a = vec_cast<double>(mesh.vertices[face.x]);
        const Vec3d normal = cross(vec_cast<double>(mesh.vertices[face.y]) - a,
                                   vec_cast<double>(mesh.vertices[face.z]) - a);
        for (int c = 0; c < 3; ++c) sums[face[c]] += normal;  // its length is twice the area
    }
    std::vector<Vec3f> normals(sums.size());
    for (std::size_t i = 0; i < sums.size(); ++i)
        if (const double length = norm(sums[i]); length > 0)
            normals[i] = vec_cast<float>(sums[i] / length);
    return normals;
}

}  // namespace tvsgs
