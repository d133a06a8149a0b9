#include <limits>

#include "core/error.h"
#include "core/grouped.h"
#include "io/mesh/glb_chunk.h"
#include "io/mesh/mesh_files.h"

namespace tvsgs {
namespace {

using glb::Chunk, glb::list_of, glb::put;
using json = nlohmann::json;

constexpr const char* kInstead =
    "write a .ply, or make a coarser mesh (--error, --faces, --voxel-size)";
constexpr std::size_t kMostVertices = 65535;  // per part: 16-bit indices, and 65535 is reserved
constexpr std::size_t kPositionBytes = 12, kNormalBytes = 12, kPlaceBytes = 8, kColorBytes = 8;

/// A primitive: a part of the mesh that 16-bit indices can address. Each of its vertices has one
/// texture coordinate.
struct Part {
    std::vector<int> vertices, places;  // indices; untextured: no places
    std::vector<std::uint16_t> corners;
};

std::vector<Part> parts_of(const std::string& path,
                           const TriangleMesh& mesh,
                           const MeshTexture& texture) {
    const bool textured = !texture.empty();
    const std::size_t keys = textured ? texture.places.size() : mesh.vertices.size();
    std::vector<int> vertex_of(keys, -1), part_of(keys, -1);
    std::vector<std::uint16_t> number(keys);
    std::vector<Part> parts;
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
        const Vec3i face = textured ? texture.faces[f] : mesh.faces[f];
        const auto is_new = [&](int key) {
            return part_of.at(static_cast<std::size_t>(key)) != static_cast<int>(parts.size()) - 1;
        };
        const auto more =
            static_cast<std::size_t>(is_new(face.x) + is_new(face.y) + is_new(face.z));
        if (parts.empty() || parts.back().vertices.size() + more > kMostVertices)
            parts.emplace_back();
        Part& part = parts.back();
        for (int c = 0; c < 3; ++c) {
            const int key = face[c], vertex = mesh.faces[f][c];
            if (vertex_of[key] >= 0 && vertex_of[key] != vertex)
                throw Error(ExitCode::internal, path,
                            ": not written: a place in the texture has two vertices, ",
                            vertex_of[key], " and ", vertex);
            if (is_new(key)) {
                vertex_of[key] = vertex, part_of[key] = static_cast<int>(parts.size()) - 1;
                number[key] = static_cast<std::uint16_t>(part.vertices.size());
                part.vertices.push_back(vertex);
                if (textured) part.places.push_back(key);
            }
            part.corners.push_back(number[key]);
        }
    }
    return parts;
}

/// One array of the file with the elements of all parts.
struct Array {
    int view = 0;
    std::size_t size;      // bytes of an element
    std::size_t done = 0;  // elements of the preceding parts

    std::size_t next(std::size_t count) {  // offset of the next part's elements
        const std::size_t offset = done * size;
        done += count;
        return offset;
    }
};

/// Calls put_one(i) for the indices `which` of all parts.
template <class Put>
Array put_array(Chunk& chunk,
                const std::vector<Part>& parts,
                std::vector<int> Part::*which,
                std::size_t size,
                const Put& put_one) {
    Array array{0, size};
    const std::size_t begin = chunk.bytes.size();
    for (const Part& part : parts)
        for (const int i : part.*which) put_one(i);
    array.view = chunk.add_view(begin, glb::kVertexTarget, static_cast<int>(size));
    return array;
}

json put_parts(Chunk& chunk,
               const std::vector<Part>& parts,
               const TriangleMesh& mesh,
               const MeshTexture& texture,
               bool with_normals) {
    const bool textured = !texture.empty(), colored = !textured && !mesh.colors.empty();
    std::size_t vertices = 0, corners = 0;
    for (const Part& part : parts) vertices += part.vertices.size(), corners += part.corners.size();
    chunk.bytes.reserve(chunk.bytes.size() + 2 * corners + 40 * vertices);
    Array positions = put_array(chunk, parts, &Part::vertices, kPositionBytes,
                                [&](int v) { put(chunk.bytes, mesh.vertices[v]); });
    Array normals{0, kNormalBytes}, places{0, kPlaceBytes}, colors{0, kColorBytes}, indices{0, 2};
    if (with_normals)
        normals = put_array(
            chunk, parts, &Part::vertices, kNormalBytes,
            [&, of_vertices = vertex_normals(mesh)](int v) {
                const Vec3f n = of_vertices[v];
                put(chunk.bytes, norm(n) > 0.5f ? n : Vec3f{0, 0, 1});  // zero area: any normal
            });
    if (textured)
        places = put_array(chunk, parts, &Part::places, kPlaceBytes, [&](int p) {
            put(chunk.bytes, texture.places[p].x), put(chunk.bytes, texture.places[p].y);
        });
    if (colored)
        colors = put_array(chunk, parts, &Part::vertices, kColorBytes, [&](int v) {
            for (int c = 0; c < 3; ++c) put(chunk.bytes, glb::linear_u16(mesh.colors[v][c]));
            put(chunk.bytes, std::uint16_t{65535});  // alpha, for alignment
        });
    const std::size_t begin = chunk.bytes.size();
    for (const Part& part : parts)
        for (const std::uint16_t corner : part.corners) put(chunk.bytes, corner);
    indices.view = chunk.add_view(begin, glb::kIndexTarget);

    json primitives = json::array();
    for (const Part& part : parts) {
        const std::size_t count = part.vertices.size();
        json attributes{
            {"POSITION", chunk.add_positions(positions.view, count, positions.next(count))}};
        const auto add = [&](const char* name, Array& array, glb::ComponentType component,
                             const char* type) {
            attributes[name] =
                chunk.add_accessor(array.view, component, type, count, array.next(count));
        };
        if (with_normals) add("NORMAL", normals, glb::f32, "VEC3");
        if (textured) add("TEXCOORD_0", places, glb::f32, "VEC2");
        if (colored) {
            add("COLOR_0", colors, glb::u16, "VEC4");
            chunk.accessors.back()["normalized"] = true;
        }
        const int index = chunk.add_accessor(indices.view, glb::u16, "SCALAR", part.corners.size(),
                                             indices.next(part.corners.size()));
        primitives.push_back({{"attributes", std::move(attributes)},
                              {"indices", index},
                              {"material", 0},
                              {"mode", glb::kTriangles}});
    }
    return primitives;
}

const char* mime_type(TextureFormat format) {
    return format == TextureFormat::jpeg  ? "image/jpeg"
           : format == TextureFormat::png ? "image/png"
                                          : "image/webp";
}

void put_texture(Chunk& chunk, json& doc, const MeshTexture& texture, TextureFormat format) {
    const std::size_t begin = chunk.bytes.size();
    chunk.bytes += encode_texture(texture.image, format);
    doc["images"] =
        list_of({{"bufferView", chunk.add_view(begin, 0)}, {"mimeType", mime_type(format)}});
    doc["samplers"] = list_of({{"magFilter", glb::kLinear},
                               {"minFilter", glb::kLinearMipmapLinear},
                               {"wrapS", glb::kClampToEdge},
                               {"wrapT", glb::kClampToEdge}});
    json source{{"sampler", 0}, {"source", 0}};
    if (format == TextureFormat::webp) {
        source.erase("source");
        source["extensions"]["EXT_texture_webp"]["source"] = 0;
        doc["extensionsUsed"].push_back("EXT_texture_webp");
        doc["extensionsRequired"] = list_of("EXT_texture_webp");
    }
    doc["textures"] = list_of(std::move(source));
    doc["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = 0;
}

}  // namespace

std::string glb_bytes(const std::string& path,
                      const TriangleMesh& mesh,
                      const MeshTexture& texture,
                      const MeshFileOptions& options) {
    require_glb_room(path, mesh.vertices.size(), mesh.faces.size(), !texture.empty());
    json doc = glb::document("KHR_materials_unlit", options.origin, options.projection, "vertices",
                             mesh.vertices.size());
    // Unlit, because the colours contain the photographs' light. Double-sided, because a fused
    // surface has holes.
    doc["materials"] =
        list_of({{"name", "photographs"},
                 {"doubleSided", true},
                 {"extensions", {{"KHR_materials_unlit", json::object()}}},
                 {"pbrMetallicRoughness", {{"metallicFactor", 0}, {"roughnessFactor", 1}}}});
    if (mesh.faces.empty()) {  // glTF forbids empty meshes and empty scenes
        doc["scenes"] = list_of(json::object());
        doc.erase("materials"), doc.erase("extensionsUsed");
    }
    Chunk chunk;
    if (!mesh.faces.empty()) {
        glb::add_scene(
            doc, "mesh",
            put_parts(chunk, parts_of(path, mesh, texture), mesh, texture, options.normals),
            options.upright_from_scene);
        if (!texture.empty()) put_texture(chunk, doc, texture, options.texture_format);
    }
    return glb::file_bytes(path, doc, chunk, kInstead);
}

void require_glb_room(const std::string& path,
                      std::size_t vertices,
                      std::size_t faces,
                      bool textured) {
    const std::uint64_t bytes =
        6 * std::uint64_t{faces} +
        std::uint64_t{vertices} * (kPositionBytes + (textured ? kPlaceBytes : 0));
    if (bytes > std::numeric_limits<std::uint32_t>::max())
        throw Error(ExitCode::input, path, ": not written: ", grouped(faces), " faces and ",
                    grouped(vertices), " vertices need ", grouped(bytes),
                    " bytes, a GLB has at most 2^32; ", kInstead);
}

}  // namespace tvsgs
