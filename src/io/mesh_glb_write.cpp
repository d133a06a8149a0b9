#include "core/error.h"
#include "core/version.h"
#include "io/glb_chunk.h"
#include "io/mesh_glb.h"

namespace tvsgs {
namespace {

using glb::Chunk, glb::list_of, glb::put;
using json = nlohmann::json;

/// The vertices of the file: those of the mesh, in their order, then copies of them, as a vertex
/// has one place in the texture.
struct Layout {
    std::vector<int> copied;    // of the vertices beyond those of the mesh: the vertex
    std::vector<int> of_place;  // the vertex of the file that has this place
};

Layout lay_out(const std::string& path, const TriangleMesh& mesh, const MeshTexture& texture) {
    Layout out;
    const int count = static_cast<int>(mesh.vertices.size());
    out.of_place.assign(texture.places.size(), -1);
    std::vector<char> taken(mesh.vertices.size(), 0);
    for (std::size_t f = 0; f < texture.faces.size(); ++f)
        for (int c = 0; c < 3; ++c) {
            const int vertex = mesh.faces[f][c];
            int& of_place = out.of_place.at(static_cast<std::size_t>(texture.faces[f][c]));
            if (of_place < 0) {
                of_place = taken[vertex] ? count + static_cast<int>(out.copied.size()) : vertex;
                if (taken[vertex]) out.copied.push_back(vertex);
                taken[vertex] = 1;
            }
            const int found = of_place < count ? of_place : out.copied[of_place - count];
            if (found != vertex)
                throw Error(ExitCode::internal,
                            str(path, ": not written: a place in the texture has two vertices, ",
                                found, " and ", vertex));
        }
    return out;
}

template <class T, class Action>
void for_each_vertex(const std::vector<T>& values, const Layout& layout, const Action& action) {
    for (const T& value : values) action(value);
    for (const int vertex : layout.copied) action(values[vertex]);
}

int put_positions(Chunk& chunk, const TriangleMesh& mesh, const Layout& layout) {
    const std::size_t begin = chunk.bytes.size();
    for_each_vertex(mesh.vertices, layout, [&](Vec3f v) { put(chunk.bytes, v); });
    return chunk.add_positions(begin, mesh.vertices.size() + layout.copied.size());
}

int put_normals(Chunk& chunk, const TriangleMesh& mesh, const Layout& layout) {
    const std::size_t begin = chunk.bytes.size();
    for_each_vertex(vertex_normals(mesh), layout, [&](Vec3f n) {
        put(chunk.bytes, norm(n) > 0.5f ? n : Vec3f{0, 0, 1});  // unused vertices have none
    });
    const int view = chunk.add_view(begin, glb::kVertexTarget);
    return chunk.add_accessor(view, glb::f32, "VEC3", mesh.vertices.size() + layout.copied.size());
}

int put_places(Chunk& chunk,
               const TriangleMesh& mesh,
               const MeshTexture& texture,
               const Layout& layout) {
    std::vector<Vec2f> places(mesh.vertices.size() + layout.copied.size());
    for (std::size_t i = 0; i < texture.places.size(); ++i)
        if (layout.of_place[i] >= 0) places[layout.of_place[i]] = texture.places[i];
    const std::size_t begin = chunk.bytes.size();
    for (const Vec2f place : places) put(chunk.bytes, place.x), put(chunk.bytes, place.y);
    return chunk.add_accessor(chunk.add_view(begin, glb::kVertexTarget), glb::f32, "VEC2",
                              places.size());
}

int put_colors(Chunk& chunk, const TriangleMesh& mesh) {
    const std::size_t begin = chunk.bytes.size();
    for (const Vec3f color : mesh.colors) {
        for (int c = 0; c < 3; ++c) put(chunk.bytes, glb::linear_u16(color[c]));
        put(chunk.bytes, std::uint16_t{65535});  // opaque; three would not be aligned
    }
    const int accessor = chunk.add_accessor(chunk.add_view(begin, glb::kVertexTarget), glb::u16,
                                            "VEC4", mesh.colors.size());
    chunk.accessors.back()["normalized"] = true;
    return accessor;
}

int put_indices(Chunk& chunk,
                const TriangleMesh& mesh,
                const MeshTexture& texture,
                const Layout& layout) {
    const bool narrow = mesh.vertices.size() + layout.copied.size() <= 65535;
    const std::size_t begin = chunk.bytes.size();
    for (std::size_t f = 0; f < mesh.faces.size(); ++f)
        for (int c = 0; c < 3; ++c) {
            const int vertex =
                texture.empty() ? mesh.faces[f][c] : layout.of_place[texture.faces[f][c]];
            if (narrow)
                put(chunk.bytes, static_cast<std::uint16_t>(vertex));
            else
                put(chunk.bytes, static_cast<std::uint32_t>(vertex));
        }
    return chunk.add_accessor(chunk.add_view(begin, glb::kIndexTarget),
                              narrow ? glb::u16 : glb::u32, "SCALAR", 3 * mesh.faces.size());
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
    const Layout layout = lay_out(path, mesh, texture);
    const Vec3d o = options.origin;
    json doc{{"asset",
              {{"version", "2.0"},
               {"generator", kVersion},
               {"extras", {{"origin", {o.x, o.y, o.z}}, {"vertices", mesh.vertices.size()}}}}},
             {"scene", 0},
             {"extensionsUsed", list_of("KHR_materials_unlit")}};
    // The photographs' light is in the colours. Both sides are drawn: a fused surface has holes.
    doc["materials"] =
        list_of({{"name", "photographs"},
                 {"doubleSided", true},
                 {"extensions", {{"KHR_materials_unlit", json::object()}}},
                 {"pbrMetallicRoughness", {{"metallicFactor", 0}, {"roughnessFactor", 1}}}});
    if (mesh.faces.empty()) {  // a mesh without a primitive is not glTF, a scene without nodes is
        doc["scenes"] = list_of(json::object());
        doc.erase("materials"), doc.erase("extensionsUsed");
    }
    Chunk chunk;
    if (!mesh.faces.empty()) {
        json attributes{{"POSITION", put_positions(chunk, mesh, layout)},
                        {"NORMAL", put_normals(chunk, mesh, layout)}};
        if (!texture.empty())
            attributes["TEXCOORD_0"] = put_places(chunk, mesh, texture, layout);
        else if (!mesh.colors.empty())
            attributes["COLOR_0"] = put_colors(chunk, mesh);
        const int indices = put_indices(chunk, mesh, texture, layout);
        json primitive{{"attributes", std::move(attributes)},
                       {"indices", indices},
                       {"material", 0},
                       {"mode", glb::kTriangles}};
        doc["meshes"] = list_of({{"primitives", list_of(std::move(primitive))}});
        json node{{"mesh", 0}, {"name", "mesh"}};
        glb::set_turn(node, options.upright_from_scene);
        doc["nodes"] = list_of(std::move(node));
        doc["scenes"] = list_of({{"nodes", list_of(0)}});
        if (!texture.empty()) put_texture(chunk, doc, texture, options.texture_format);
    }
    return glb::file_bytes(path, doc, chunk, "name a .ply, or make a coarser mesh");
}

}  // namespace tvsgs
