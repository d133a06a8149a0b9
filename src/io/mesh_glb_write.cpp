#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/version.h"
#include "io/glb_format.h"
#include "io/mesh_glb.h"

namespace tvsgs {
namespace {

using json = nlohmann::json;

static_assert(std::endian::native == std::endian::little, "glTF is little-endian");

template <class T>
void put(std::string& out, const T& value) {
    static_assert(std::is_arithmetic_v<T>);
    out.append(reinterpret_cast<const char*>(&value), sizeof value);
}
void put(std::string& out, Vec3f v) {
    put(out, v.x), put(out, v.y), put(out, v.z);
}

/// A list of one; braces alone could mean the element itself.
json list_of(json element) {
    json list = json::array();
    list.push_back(std::move(element));
    return list;
}

/// One binary chunk in the making, with the views and accessors that say what is in it.
struct Chunk {
    std::string bytes;
    json views = json::array(), accessors = json::array();

    /// A view of what has been put since `begin`; `target` 0: none.
    int add_view(std::size_t begin, int target) {
        json view{{"buffer", 0}, {"byteOffset", begin}, {"byteLength", bytes.size() - begin}};
        if (target != 0) view["target"] = target;
        views.push_back(std::move(view));
        bytes.resize((bytes.size() + 3) / 4 * 4, '\0');
        return static_cast<int>(views.size()) - 1;
    }
    int add_accessor(int view, glb::ComponentType component, const char* type, std::size_t count) {
        accessors.push_back(
            {{"bufferView", view}, {"componentType", component}, {"type", type}, {"count", count}});
        return static_cast<int>(accessors.size()) - 1;
    }
};

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
    constexpr float kMost = std::numeric_limits<float>::max();
    Vec3f lower{kMost, kMost, kMost}, upper = -lower;
    for_each_vertex(mesh.vertices, layout, [&](Vec3f v) {
        put(chunk.bytes, v);
        for (int a = 0; a < 3; ++a)
            lower[a] = std::min(lower[a], v[a]), upper[a] = std::max(upper[a], v[a]);
    });
    const int view = chunk.add_view(begin, glb::kVertexTarget);
    const int accessor =
        chunk.add_accessor(view, glb::f32, "VEC3", mesh.vertices.size() + layout.copied.size());
    chunk.accessors.back()["min"] = {lower.x, lower.y, lower.z};
    chunk.accessors.back()["max"] = {upper.x, upper.y, upper.z};
    return accessor;
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

/// sRGB to linear light in 16 bits, as 8 would show bands in the dark.
/// [docs/method/texture.md#files]
std::uint16_t linear_u16(float srgb) {
    const float c = std::clamp(srgb, 0.0f, 1.0f);
    const float linear = c <= 0.04045f ? c / 12.92f : std::pow((c + 0.055f) / 1.055f, 2.4f);
    return static_cast<std::uint16_t>(linear * 65535 + 0.5f);
}

int put_colors(Chunk& chunk, const TriangleMesh& mesh) {
    const std::size_t begin = chunk.bytes.size();
    for (const Vec3f color : mesh.colors) {
        for (int c = 0; c < 3; ++c) put(chunk.bytes, linear_u16(color[c]));
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

bool is_identity(const Mat3<double>& R) {
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            if (R[i][j] != (i == j)) return false;
    return true;
}

void put_chunk(std::string& out, std::uint32_t kind, const std::string& bytes) {
    put(out, static_cast<std::uint32_t>(bytes.size()));
    put(out, kind);
    out += bytes;
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
        const Mat3<double>& R = options.upright_from_scene;
        if (!is_identity(R))  // column by column
            node["matrix"] = {R[0][0], R[1][0], R[2][0], 0, R[0][1], R[1][1], R[2][1], 0,
                              R[0][2], R[1][2], R[2][2], 0, 0,       0,       0,       1};
        doc["nodes"] = list_of(std::move(node));
        doc["scenes"] = list_of({{"nodes", list_of(0)}});
        if (!texture.empty()) put_texture(chunk, doc, texture, options.texture_format);
        doc["bufferViews"] = std::move(chunk.views);
        doc["accessors"] = std::move(chunk.accessors);
        doc["buffers"] = list_of({{"byteLength", chunk.bytes.size()}});
    }
    std::string text = doc.dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    const std::uint64_t total = glb::kHeaderBytes + glb::kChunkBytes + text.size() +
                                (chunk.bytes.empty() ? 0 : glb::kChunkBytes + chunk.bytes.size());
    if (total > std::numeric_limits<std::uint32_t>::max())
        throw Error(ExitCode::input, str(path, ": not written: ", total,
                                         " bytes, and a GLB has at most 2^32; name a .ply, or make "
                                         "a coarser mesh"));
    std::string out;
    out.reserve(total);
    put(out, glb::kMagic), put(out, glb::kVersion), put(out, static_cast<std::uint32_t>(total));
    put_chunk(out, glb::kJson, text);
    if (!chunk.bytes.empty()) put_chunk(out, glb::kBin, chunk.bytes);
    return out;
}

}  // namespace tvsgs
