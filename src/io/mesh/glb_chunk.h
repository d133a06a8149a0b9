// Constants of glTF 2.0 and its binary container, and writing: JSON, buffer views and accessors,
// shared by the writers of meshes and splats.
// https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html
#pragma once

#include <bit>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "core/math/vec.h"
#include "io/files/number_types.h"

namespace tvsgs::glb {

inline constexpr std::uint32_t kMagic = 0x46546C67, kVersion = 2, kJson = 0x4E4F534A,
                               kBin = 0x004E4942;
inline constexpr std::uint32_t kHeaderBytes = 12, kChunkBytes = 8;

enum ComponentType { i8 = 5120, u8 = 5121, i16 = 5122, u16 = 5123, u32 = 5125, f32 = 5126 };
inline constexpr int kPoints = 0, kTriangles = 4, kVertexTarget = 34962, kIndexTarget = 34963;
inline constexpr int kLinear = 9729, kLinearMipmapLinear = 9987, kClampToEdge = 33071;

static_assert(std::endian::native == std::endian::little, "glTF is little-endian");

using tvsgs::put;
inline void put(std::string& out, Vec3f v) {
    put(out, v.x), put(out, v.y), put(out, v.z);
}

/// A JSON list of one element. Braces alone could mean the element itself.
nlohmann::json list_of(nlohmann::json element);

/// The binary chunk, with the buffer views and accessors that describe its content.
struct Chunk {
    std::string bytes;
    nlohmann::json views = nlohmann::json::array(), accessors = nlohmann::json::array();

    /// Adds a buffer view of the bytes since `begin`; `target` 0: none. `stride`: bytes from one
    /// element to the next, for views with several accessors.
    int add_view(std::size_t begin, int target, int stride = 0);
    /// `offset`: bytes from the start of the view.
    int add_accessor(int view,
                     ComponentType component,
                     const char* type,
                     std::size_t count,
                     std::size_t offset = 0);
    /// Adds an accessor of float vectors with the bounds that glTF requires for positions.
    int add_positions(int view, std::size_t count, std::size_t offset = 0);
};

/// sRGB to linear light in 16 bits; 8 bits would show bands in dark regions.
/// [docs/method/texture.md#files]
std::uint16_t linear_u16(float srgb);

/// A document with one extension. asset.extras holds the origin, the projection (empty: none), and
/// `count` as `what`.
nlohmann::json document(const char* extension,
                        Vec3d origin,
                        const std::string& projection,
                        const char* what,
                        std::size_t count);

/// Adds a scene with one mesh of these primitives, named `name`, below a node with rotation `R`.
void add_scene(nlohmann::json& doc,
               const char* name,
               nlohmann::json primitives,
               const Mat3<double>& R);

/// Bytes of the file; adds the description of the chunk to `doc`. Throws Error(ExitCode::input)
/// beyond the format's 4 GiB; `instead` is the advice in the message.
std::string file_bytes(const std::string& path,
                       nlohmann::json& doc,
                       Chunk& chunk,
                       const char* instead);

}  // namespace tvsgs::glb
