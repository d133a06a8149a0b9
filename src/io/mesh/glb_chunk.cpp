#include "io/mesh/glb_chunk.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "core/error.h"
#include "core/grouped.h"
#include "core/version.h"

namespace tvsgs::glb {
namespace {

using nlohmann::json;

void put_chunk(std::string& out, std::uint32_t kind, const std::string& bytes) {
    put(out, static_cast<std::uint32_t>(bytes.size()));
    put(out, kind);
    out += bytes;
}

}  // namespace

json list_of(json element) {
    json list = json::array();
    list.push_back(std::move(element));
    return list;
}

int Chunk::add_view(std::size_t begin, int target, int stride) {
    json view{{"buffer", 0}, {"byteOffset", begin}, {"byteLength", bytes.size() - begin}};
    if (target != 0) view["target"] = target;
    if (stride != 0) view["byteStride"] = stride;
    views.push_back(std::move(view));
    bytes.resize((bytes.size() + 3) / 4 * 4, '\0');
    return static_cast<int>(views.size()) - 1;
}

int Chunk::add_accessor(
    int view, ComponentType component, const char* type, std::size_t count, std::size_t offset) {
    accessors.push_back(
        {{"bufferView", view}, {"componentType", component}, {"type", type}, {"count", count}});
    if (offset != 0) accessors.back()["byteOffset"] = offset;
    return static_cast<int>(accessors.size()) - 1;
}

int Chunk::add_positions(int view, std::size_t count, std::size_t offset) {
    constexpr float kMost = std::numeric_limits<float>::max();
    Vec3f lower{kMost, kMost, kMost}, upper = -lower;
    const std::size_t begin = views[view]["byteOffset"].get<std::size_t>() + offset;
    for (std::size_t i = 0; i < count; ++i) {
        Vec3f p;
        std::memcpy(&p, &bytes[begin + i * sizeof p], sizeof p);
        for (int a = 0; a < 3; ++a)
            lower[a] = std::min(lower[a], p[a]), upper[a] = std::max(upper[a], p[a]);
    }
    const int accessor = add_accessor(view, f32, "VEC3", count, offset);
    accessors.back()["min"] = {lower.x, lower.y, lower.z};
    accessors.back()["max"] = {upper.x, upper.y, upper.z};
    return accessor;
}

std::uint16_t linear_u16(float srgb) {
    const float c = std::clamp(srgb, 0.0f, 1.0f);
    const float linear = c <= 0.04045f ? c / 12.92f : std::pow((c + 0.055f) / 1.055f, 2.4f);
    return static_cast<std::uint16_t>(linear * 65535 + 0.5f);
}

json document(const char* extension,
              Vec3d origin,
              const std::string& projection,
              const char* what,
              std::size_t count) {
    json extras{{"origin", {origin.x, origin.y, origin.z}}, {what, count}};
    if (!projection.empty()) extras["projection"] = projection;
    return {{"asset", {{"version", "2.0"}, {"generator", tvsgs::kVersion}, {"extras", extras}}},
            {"scene", 0},
            {"extensionsUsed", list_of(extension)}};
}

void add_scene(json& doc, const char* name, json primitives, const Mat3<double>& R) {
    json node{{"mesh", 0}, {"name", name}};
    bool is_identity = true;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) is_identity = is_identity && R[i][j] == (i == j);
    if (!is_identity)  // column major
        node["matrix"] = {R[0][0], R[1][0], R[2][0], 0, R[0][1], R[1][1], R[2][1], 0,
                          R[0][2], R[1][2], R[2][2], 0, 0,       0,       0,       1};
    doc["meshes"] = list_of({{"primitives", std::move(primitives)}});
    doc["nodes"] = list_of(std::move(node));
    doc["scenes"] = list_of({{"nodes", list_of(0)}});
}

std::string file_bytes(const std::string& path, json& doc, Chunk& chunk, const char* instead) {
    if (!chunk.bytes.empty()) {
        doc["bufferViews"] = std::move(chunk.views);
        doc["accessors"] = std::move(chunk.accessors);
        doc["buffers"] = list_of({{"byteLength", chunk.bytes.size()}});
    }
    std::string text = doc.dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    const std::uint64_t total = kHeaderBytes + kChunkBytes + text.size() +
                                (chunk.bytes.empty() ? 0 : kChunkBytes + chunk.bytes.size());
    if (total > std::numeric_limits<std::uint32_t>::max())
        throw Error(ExitCode::input, path, ": not written: ", grouped(total),
                    " bytes, a GLB has at most 2^32; ", instead);
    std::string out;
    out.reserve(total);
    put(out, kMagic), put(out, kVersion), put(out, static_cast<std::uint32_t>(total));
    put_chunk(out, kJson, text);
    if (!chunk.bytes.empty()) put_chunk(out, kBin, chunk.bytes);
    return out;
}

}  // namespace tvsgs::glb
